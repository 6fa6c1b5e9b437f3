"""Painting: execute some strokes, look at the canvas, replan the rest, until all are made (thesis 4.3.5)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pentimento.contracts.colour import srgb_to_linear, to_float
from pentimento.contracts.covariates import Memory, fresh_memory
from pentimento.contracts.markers import markers_around
from pentimento.contracts.plan import PlannedStroke
from pentimento.planning.config import Log, PlannerConfig
from pentimento.planning.descent import optimise
from pentimento.planning.scene import Scene, render_plan
from pentimento.planning.strokes import StrokeTensors, to_planned
from pentimento.robots.driver import Robot
from pentimento.runner.act import Session, execute
from pentimento.runner.observe import CameraCalibration, calibrate_camera, rectify
from pentimento.stroke_dynamics.photometry import linear_to_srgb

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
    foretold: Image
    """What the first plan said the finished painting would look like, sRGB [H, W, 3]."""


def paint(
    robot: Robot,
    scene: Scene,
    strokes: StrokeTensors,
    palette_srgb: FloatArray,
    batch: int,
    replan: bool,
    config: PlannerConfig,
    log: Log,
) -> Painting:
    """Execute a plan in batches of ``batch`` strokes with a photograph after each.

    With ``replan``, the remaining strokes are optimised on each photograph; without, the plan stays as it is. A scene
    whose model is extended by causes with memory goes on from what tool and canvas have been through.
    ``log("deviation", value, strokes made)`` is called after each batch.
    """
    calibration = calibrate_camera(robot.photo(), markers_around(robot.canvas_size_m))
    session = Session("painting", robot.clock_s)
    memory = fresh_memory(robot.canvas_size_m, scene.tool.nominal_width_m)
    photos = [observe(robot, calibration, config.pixels_per_m)]
    left = strokes.pick(slice(None))
    left.inherited = None
    first = foretell(left, photos[0], scene, config)
    executed: list[PlannedStroke] = []
    deviation = [0.0]
    while len(left) > 0:
        now = to_planned(left.pick(slice(0, batch)), scene.tool, config.path_points)
        memory, _ = execute(robot, scene.tool, now, palette_srgb, memory, session)
        executed += now
        scene = _going_on(scene, memory, robot.clock_s - session.started_s, len(executed))
        left = left.pick(slice(batch, None))
        left.inherited = None  # what was foreseen has happened, or something else
        photos.append(observe(robot, calibration, config.pixels_per_m))
        if replan and len(left) > 0:
            optimise(
                left, as_linear(photos[-1]), scene, config, config.iterations_replan, False, config.replan_rate,
                _unheard, 0,
            )  # fmt: skip
            left.inherited = None
        foretold = foretell(left, photos[-1], scene, config)
        deviation.append(float((foretold - first).square().mean()))
        log("deviation", deviation[-1], len(executed))
    return Painting(executed, photos, deviation, _as_image(first))


def _going_on(scene: Scene, memory: Memory, clock_s: float, made: int) -> Scene:
    """The scene for the strokes that are left."""
    if scene.extension is None:
        return scene
    return replace(scene, extension=replace(scene.extension, memory=memory, clock_s=clock_s, made=made))


def observe(robot: Robot, calibration: CameraCalibration, pixels_per_m: float) -> Image:
    """A photograph of the whole canvas, sRGB [H, W, 3]."""
    return rectify(robot.photo(), calibration, (0.0, 0.0, *robot.canvas_size_m), pixels_per_m)


def as_linear(photo: Image) -> Tensor:
    """A photograph as the canvas to plan on, linear light [H, W, 3]."""
    return torch.tensor(srgb_to_linear(to_float(photo)), dtype=torch.float32)


def foretell(strokes: StrokeTensors, photo: Image, scene: Scene, config: PlannerConfig) -> Tensor:
    """What the canvas will look like after the strokes, sRGB [H, W, 3]."""
    with torch.no_grad():
        return linear_to_srgb(render_plan(strokes, as_linear(photo), scene, config.path_points))


def _as_image(srgb: Tensor) -> Image:
    return (srgb.clamp(0, 1) * 255).round().to(torch.uint8).numpy()


def _unheard(_name: str, _value: float, _step: int) -> None:
    """Curves of single replannings are not kept."""
