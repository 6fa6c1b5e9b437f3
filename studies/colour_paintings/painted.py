"""Plan and execute one picture in the studio, with replanning, as the stage ``paint`` does."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from numpy.typing import NDArray

from pentimento.calibration.observe import calibrate_camera
from pentimento.contracts.markers import markers_around
from pentimento.control.guard import GuardedRobot
from pentimento.control.painter import Image, as_linear, observe, paint
from pentimento.control.safety import envelope_for
from pentimento.dynamics.strokes.extended import read_stroke_model
from pentimento.dynamics.strokes.planned import TorchBrush
from pentimento.planning.strokes.config import PlannerConfig, no_log
from pentimento.planning.strokes.planner import plan
from pentimento.planning.strokes.scene import scene_with
from pentimento.robots.tools import load_tool
from pentimento.robots.virtual import VirtualRobot
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import load_world
from studies.colour_paintings.frida import FridaConfig, frida_plan
from studies.colour_paintings.pictures import Picture

_TOOL = "round_brush"


@dataclass(frozen=True)
class Painted:
    """A painting and what it was painted after."""

    target: NDArray
    """[H, W, 3], linear light."""
    paper: Image
    """The blank sheet, sRGB [H, W, 3]."""
    predicted: Image
    """By the first plan."""
    painting: Image
    """The last photograph."""
    palette: NDArray
    """sRGB [K, 3]."""
    planning_s: float
    """Seconds of processor time of the first plan."""
    replanning_s: float
    """Seconds of processor time of the execution with replanning."""


def painted(
    picture: Picture,
    planner: PlannerConfig,
    frida: FridaConfig | None,
    *,
    weights: Path,
    strokes: int,
    replan_every: int,
    seed: int,
) -> Painted:
    """Paint a picture; with FRIDA's planner where its settings are given.

    Args:
        weights: folder of the round brush's stroke model.
        strokes: largest number of strokes.
        replan_every: strokes between two photographs.
        seed: of the studio.
    """
    tool, virtual = load_tool(_TOOL), VirtualRobot(Studio(load_world(_TOOL), seed))
    robot = GuardedRobot(virtual, envelope_for(tool, virtual.canvas_size_m))
    calibration = calibrate_camera(robot.photo(), markers_around(robot.canvas_size_m))
    paper = observe(robot, calibration, planner.pixels_per_m)
    target = picture.target(paper.shape[:2])
    brush = TorchBrush(read_stroke_model(weights), tool, planner.path_points)
    scene = scene_with(brush, tool, robot.canvas_size_m, target)
    begun = time.process_time()
    if frida is None:
        plan_strokes, palette = plan(as_linear(paper), scene, strokes, planner, no_log)
    else:
        plan_strokes, palette = frida_plan(as_linear(paper), scene, strokes, planner, frida)
    planned = time.process_time()
    painting = paint(
        robot, scene, plan_strokes, palette_srgb=palette, replan_every=replan_every, replan=True, config=planner,
        log=no_log,
    )  # fmt: skip
    return Painted(
        target, paper, painting.predicted, painting.photos[-1], palette, planned - begun,
        time.process_time() - planned,
    )  # fmt: skip
