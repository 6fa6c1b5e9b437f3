"""A small sheet with a marker, for tests of plans."""

import numpy as np
from numpy.typing import NDArray

from pentimento.copainting.evaluation.goal_plans import Medium, PaintContext
from pentimento.copainting.scenes.ink import InkTones
from pentimento.dynamics.strokes.extended import base_model
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from pentimento.planning.strokes.config import (
    PRINT_ALONE,
    ExecutionNoise,
    LearningRates,
    PlannerConfig,
)
from pentimento.planning.strokes.palette import PaletteChoice
from pentimento.robots.tools import load_tool

SIDE_PX = 32
PLANNER = PlannerConfig(
    initialisation="error_guided", candidates=4, rounds=2, sizes=(0.5, 0.2), iterations_per_round=4, iterations_free=12,
    iterations_palette=0, iterations_replan=2, replan_rate=0.3, relocate_every=6, relocate_share=0.2,
    min_gain_per_stroke=0.0,
    palette=PaletteChoice("ink", None, None, None), sweeps=1, path_points=10, pixels_per_m=480.0, edge_m=0.003,
    distances_px=(1, 2), objectives=PRINT_ALONE, execution_noise=ExecutionNoise(0.0, 0.0),
    learning_rates=LearningRates(0.0008, 0.04, 0.0008, 0.0005, 0.00002, 0.0), seed=0,
)  # fmt: skip
MEDIUM = Medium("marker", 0.1, "with a marker", InkTones(0.001, 0.15, 0.3), PLANNER)
PARAMETERS = Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 0.1, 1.5e-3, 0.2, 0.95)


def marker_paint_context() -> PaintContext:
    """A sheet of 100 mm, planned at 48 px."""
    return PaintContext(MEDIUM, load_tool("marker"), base_model(PARAMETERS))


def paper() -> NDArray[np.uint8]:
    return np.full((SIDE_PX, SIDE_PX, 3), 250, np.uint8)


def cross() -> NDArray[np.uint8]:
    """Two dark bars on paper."""
    picture = paper()
    picture[15:17, 5:27] = 20
    picture[5:27, 15:17] = 20
    return picture
