"""A small picture, a brush and strokes for the planner's tests."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pentimento.dynamics.strokes.extended import base_model
from pentimento.dynamics.strokes.planned import TorchBrush
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from pentimento.planning.objectives import PrintObjective
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.config import (
    PRINT_ALONE,
    ExecutionNoise,
    LearningRates,
    PlannerConfig,
)
from pentimento.planning.strokes.palette import PaletteChoice
from pentimento.planning.strokes.render_plan import render_plan
from pentimento.planning.strokes.scene import Scene, scene_with
from pentimento.robots.tools import load_tool

Array = NDArray[np.float32]
SIZE_M = (0.12, 0.08)
PARAMETERS = Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 1.0, 2e-3, 0.2, 0.95)
POINTS = 10
RATES = LearningRates(2.4e-3, 0.12, 2.4e-3, 1.2e-3, 4e-4, 0.06)
CONFIG = PlannerConfig(
    initialisation="error_guided",
    candidates=4,
    rounds=2,
    sizes=(0.8, 0.0),
    iterations_per_round=10,
    iterations_free=12,
    iterations_palette=15,
    iterations_replan=10,
    replan_rate=0.1,
    relocate_every=5,
    relocate_share=0.2,
    min_gain_per_stroke=0.0,
    palette=PaletteChoice("plan", 3, None, None),
    sweeps=2,
    path_points=POINTS,
    pixels_per_m=500.0,
    edge_m=5e-3,
    distances_px=(1, 4),
    objectives=PRINT_ALONE,
    execution_noise=ExecutionNoise(0.0, 0.0),
    learning_rates=RATES,
    seed=1,
)
INK = replace(CONFIG, palette=PaletteChoice("ink", None, None, None))
WHITE = np.ones((40, 60, 3), np.float32)


def brush(tool: str = "round_brush", parameters: Traj2StrokeParameters = PARAMETERS) -> TorchBrush:
    return TorchBrush(base_model(parameters), load_tool(tool), POINTS)


def scene(tool: str = "round_brush") -> Scene:
    """A red disc on a green ground, lower right of the middle."""
    rows, columns = np.meshgrid(np.arange(40), np.arange(60), indexing="ij")
    inside = ((rows - 25) ** 2 + (columns - 40) ** 2 < 100)[..., None]
    target = np.where(inside, np.array([0.6, 0.05, 0.05]), np.array([0.05, 0.4, 0.1])).astype(np.float32)
    return scene_with(brush(tool), load_tool(tool), SIZE_M, target)


def loss(strokes: Strokes, canvas: Array) -> float:
    return PrintObjective(scene().target, CONFIG.distances_px)(render_plan(strokes, canvas, scene()))[0]


def strokes_at(*middles: tuple[float, float]) -> Strokes:
    """Of 20 mm, each turned a little more than the one before, in the ground's green."""
    count = len(middles)
    arrays = (
        np.array(middles), np.linspace(0, 2, count), np.full(count, 0.02), np.zeros(count), np.full((count, 3), 1e-3),
        np.tile([0.05, 0.4, 0.1], (count, 1)),
    )  # fmt: skip
    return Strokes(*(array.astype(np.float32) for array in arrays))


def same(one: Strokes, other: Strokes) -> bool:
    """Whether two plans are the same, bit by bit."""
    return all(np.array_equal(a, b) for a, b in zip(one.arrays(), other.arrays(), strict=True))


def unheard(*_: object) -> None: ...
