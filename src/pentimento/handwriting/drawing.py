"""A drawing in a hand: planned, executed by a robot, photographed, and looked at stroke by stroke."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pentimento.calibration.observe import CameraCalibration
from pentimento.contracts.colour import linear_to_srgb, to_uint8
from pentimento.contracts.covariates import fresh_memory
from pentimento.contracts.plan import PlannedStroke
from pentimento.control.execute import Session, execute
from pentimento.control.painter import as_linear, observe
from pentimento.planning.config import Log
from pentimento.planning.latent.config import HandPlanConfig
from pentimento.planning.latent.planner import PathBrush, plan_in_hand, predict_drawing
from pentimento.planning.latent.shapes import Shapes
from pentimento.planning.latent.strokes import planned_strokes
from pentimento.planning.scene import Scene
from pentimento.robots.driver import Robot

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Drawing:
    """What came of a plan."""

    planned: list[PlannedStroke]
    measured_m: list[FloatArray]
    """[N, 2] of each stroke: where the robot says that its tip went."""
    photo: Image
    """sRGB [H, W, 3]."""
    predicted: Image


def draw_in_hand(
    robot: Robot,
    calibration: CameraCalibration,
    scene: Scene,
    brush: PathBrush,
    shapes: Shapes,
    ink_m: float,
    config: HandPlanConfig,
    log: Log,
) -> Drawing:
    """Draw the scene's target with about ``ink_m`` of line, on the sheet before the robot."""
    canvas = as_linear(observe(robot, calibration, config.pixels_per_m))
    strokes = plan_in_hand(canvas, scene, brush, shapes, ink_m, config, log)
    predicted = linear_to_srgb(np.clip(predict_drawing(strokes, canvas, scene, brush), 0.0, 1.0))
    planned = planned_strokes(strokes, scene.tool)
    memory = fresh_memory(robot.canvas_size_m, scene.tool.nominal_width_m)
    ink = np.array([scene.tool.color_srgb], dtype=np.float64)
    _, measured = execute(robot, scene.tool, planned, ink, memory, Session("drawing", robot.clock_s))
    photo = observe(robot, calibration, config.pixels_per_m)
    return Drawing(planned, [_known(path) for path in measured], photo, to_uint8(predicted))


def _known(path: FloatArray) -> FloatArray:
    place = path[:, 1:3]
    return place[np.isfinite(place).all(axis=1)]
