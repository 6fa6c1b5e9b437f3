"""Test support: a stroke model in plain numpy, and a painting context for a small sheet of the studio."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from pentimento.control.journal import JournaledRobot
from pentimento.control.painter import PaintContext
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.brush import Array, Marks, Pull, Span, StrokeTiming
from pentimento.planning.strokes.config import PRINT_ALONE, ExecutionNoise, LearningRates, PlannerConfig
from pentimento.planning.strokes.palette import PaletteChoice
from pentimento.robots.driver import Robot
from pentimento.robots.strokes import shape_basis
from pentimento.robots.tools import load_tool
from pentimento.robots.virtual import VirtualRobot
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import load_world

POINTS = 8
SIDE_M = 0.1
PIXELS_PER_M = 600.0
RADIUS_M, DENSITY, SOFTNESS = 0.0011, 0.85, 0.4


class LineBrush:
    """A pen with a line of constant width; its gradient is that of the geometry."""

    fitted: Mapping[str, Span] = {}
    timing = StrokeTiming(1.0, 5.0)
    depletion = None
    path_points = POINTS

    def marks(self, strokes: Strokes, inherited: Mapping[str, Array]) -> tuple[Marks, Pull]:
        full = np.ones((len(strokes), POINTS), np.float32)
        points = strokes.paths(POINTS)[..., 1:3]
        along, across = (basis.astype(np.float32) for basis in shape_basis(POINTS))
        cos, sin = np.cos(strokes.theta_rad)[:, None], np.sin(strokes.theta_rad)[:, None]

        def pull(cotangent: Marks) -> Strokes:
            gx, gy = cotangent.points_m[..., 0], cotangent.points_m[..., 1]
            from_middle = points - strokes.middle_m[:, None]
            return Strokes(
                middle_m=np.stack([gx.sum(1), gy.sum(1)], axis=1),
                theta_rad=(gy * from_middle[..., 0] - gx * from_middle[..., 1]).sum(1),
                length_m=((gx * cos + gy * sin) * along).sum(1),
                bend_m=((gy * cos - gx * sin) * across).sum(1),
                press_m=np.zeros_like(strokes.press_m),
                color=cotangent.color,
            )

        return Marks(points, RADIUS_M * full, DENSITY * full, SOFTNESS * full, strokes.color, None), pull

    def gain(self, places_m: Array) -> None:
        return None


def paint_context(iterations: int = 30) -> PaintContext:
    """The marker with a fast planner on a sheet of SIDE_M."""
    planner = PlannerConfig(
        initialisation="error_guided",
        candidates=5,
        rounds=2,
        sizes=(0.6, 0.35),
        iterations_per_round=3,
        iterations_free=iterations,
        iterations_palette=0,
        iterations_replan=4,
        replan_rate=0.3,
        relocate_every=0,
        relocate_share=0.0,
        min_gain_per_stroke=0.0,
        palette=PaletteChoice("ink", None, None, None),
        sweeps=1,
        path_points=POINTS,
        pixels_per_m=PIXELS_PER_M,
        edge_m=0.005,
        distances_px=(1, 4),
        objectives=PRINT_ALONE,
        execution_noise=ExecutionNoise(0.0, 0.0),
        learning_rates=LearningRates(8e-4, 0.04, 8e-4, 5e-4, 0.0, 0.0),
        seed=1,
    )
    return PaintContext(load_tool("marker"), LineBrush(), (SIDE_M, SIDE_M), planner)


def sheet(seed: int = 3) -> VirtualRobot:
    """A robot with the marker and a blank sheet of SIDE_M."""
    world = load_world("marker")
    return VirtualRobot(Studio(replace(world, paper=replace(world.paper, size_m=(SIDE_M, SIDE_M))), seed))


def journaled_sheet(folder: Path, robot: Robot | None = None) -> JournaledRobot:
    """A journaled ``sheet``, or ``robot``."""
    return JournaledRobot(sheet() if robot is None else robot, folder / "journal.jsonl", load_tool)


def cross(canvas: np.ndarray) -> np.ndarray:
    """A goal: the canvas with a ring and a cross in it, as dark as the pen can."""
    goal = canvas.copy()
    rows, columns = np.mgrid[: canvas.shape[0], : canvas.shape[1]] / canvas.shape[0] - 0.5
    ring = np.abs(np.hypot(rows, columns) - 0.3) < 0.014
    bars = (np.minimum(np.abs(rows), np.abs(columns)) < 0.012) & (np.hypot(rows, columns) < 0.25)
    goal[ring | bars] = 40
    return goal
