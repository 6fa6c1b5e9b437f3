"""Painting: execute some strokes, look at the canvas, replan the rest, until all are made (thesis 4.3.5)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pentimento.calibration.observe import CameraCalibration, calibrate_camera, rectify
from pentimento.contracts.colour import linear_to_srgb, srgb_to_linear, to_float, to_uint8
from pentimento.contracts.covariates import fresh_memory
from pentimento.contracts.markers import markers_around
from pentimento.contracts.plan import PlannedStroke
from pentimento.control.execute import Session, execute
from pentimento.planning.strokes.bezier import Strokes, to_planned
from pentimento.planning.strokes.config import Log, PlannerConfig
from pentimento.planning.strokes.descent import optimise
from pentimento.planning.strokes.memory import Start
from pentimento.planning.strokes.render_plan import render_plan
from pentimento.planning.strokes.scene import Scene
from pentimento.robots.driver import Robot

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]


@dataclass(frozen=True)
class Painting:
    """What came of a plan."""

    executed: list[PlannedStroke]
    photos: list[Image]
    """The canvas, sRGB [H, W, 3], before the first stroke and after every batch."""
    deviation: list[float]
    """Mean squared difference, sRGB, between what the finished painting was foretold to be at the start and what it
    was foretold to be after each batch (thesis Figure 4.11); 0 at first, as long as ``photos``."""
    predicted: Image
    """What the first plan said the finished painting would look like, sRGB [H, W, 3]."""


def paint(
    robot: Robot,
    scene: Scene,
    strokes: Strokes,
    palette_srgb: FloatArray,
    batch: int,
    replan: bool,
    config: PlannerConfig,
    log: Log,
) -> Painting:
    """Execute a plan in batches of ``batch`` strokes with a photograph after each.

    With ``replan``, the remaining strokes are optimised on each photograph; without, the plan stays as it is. A scene
    whose brush inherits from stroke to stroke goes on from what tool and canvas have been through.
    ``log("deviation", value, strokes made)`` is called after each batch.
    """
    calibration = calibrate_camera(robot.photo(), markers_around(robot.canvas_size_m))
    session = Session("painting", robot.clock_s)
    memory = fresh_memory(robot.canvas_size_m, scene.tool.nominal_width_m)
    photos = [observe(robot, calibration, config.pixels_per_m)]
    left = strokes.pick(slice(None))
    left.inherited = None
    first = predict(left, photos[0], scene)
    executed: list[PlannedStroke] = []
    deviation = [0.0]
    while len(left) > 0:
        now = to_planned(left.pick(slice(0, batch)), scene.tool, scene.brush.path_points)
        memory, _ = execute(robot, scene.tool, now, palette_srgb, memory, session)
        executed += now
        scene = replace(scene, start=Start(memory, robot.clock_s - session.started_s, len(executed)))
        left = left.pick(slice(batch, None))
        left.inherited = None  # what was foreseen has happened, or something else
        photos.append(observe(robot, calibration, config.pixels_per_m))
        if replan and len(left) > 0:
            replan_rest(left, photos[-1], scene, config)
        predicted = predict(left, photos[-1], scene)
        deviation.append(float(np.square(predicted - first).mean()))
        log("deviation", deviation[-1], len(executed))
    return Painting(executed, photos, deviation, to_uint8(first))


def replan_rest(left: Strokes, photo: Image, scene: Scene, config: PlannerConfig) -> None:
    """Move the strokes that are left, in place, to make the best of the canvas as it is, sRGB [H, W, 3]."""
    optimise(
        left, as_linear(photo), scene, config, config.iterations_replan, False, config.replan_rate, _unheard, 0
    )  # fmt: skip
    left.inherited = None  # they are looked at anew after the next strokes


def observe(robot: Robot, calibration: CameraCalibration, pixels_per_m: float) -> Image:
    """A photograph of the whole canvas, sRGB [H, W, 3]."""
    return rectify(robot.photo(), calibration, (0.0, 0.0, *robot.canvas_size_m), pixels_per_m)


def as_linear(photo: Image) -> Array:
    """A photograph as the canvas to plan on, linear light [H, W, 3]."""
    return srgb_to_linear(to_float(photo))


def predict(strokes: Strokes, photo: Image, scene: Scene) -> Array:
    """What the canvas will look like after the strokes, sRGB [H, W, 3]."""
    return linear_to_srgb(render_plan(strokes, as_linear(photo), scene))


def _unheard(_name: str, _value: float, _step: int) -> None:
    """Curves of single replannings are not kept."""
