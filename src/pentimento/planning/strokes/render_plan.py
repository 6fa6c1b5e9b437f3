"""The predicted canvas after a plan's strokes, and the pull-back: the chain rule in one place.

strokes ─ brush ─→ marks ─ fault ─→ pixels ─ render ─→ light ─ camera ─→ image
        ←────────────────── gradients ───────────────────
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.planning.strokes.brush import Marks
from pentimento.planning.strokes.config import ExecutionNoise
from pentimento.planning.strokes.paths import PlannedPaths
from pentimento.planning.strokes.scene import Scene, inherit
from pentimento.render.kernel import render, render_backward
from pentimento.render.strokes import PixelStrokes

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]
Back = Callable[[Array], tuple[Array, ...]]
"""From ∂loss/∂image [H, W, 3] to the gradient of each of the strokes' ``arrays``."""


class Fault(NamedTuple):
    """An execution error of each stroke."""

    narrowing: Array
    """[S, 1], the remaining share of the width."""
    shift_m: Array
    """[S, 1, 2], canvas frame."""


def expected_fault(strokes: int, execution_noise: ExecutionNoise) -> Fault:
    """The mean execution error, for each stroke."""
    narrowing = np.full((strokes, 1), 1 - execution_noise.thinning / 2, np.float32)
    return Fault(narrowing, np.zeros((strokes, 1, 2), np.float32))


def faults(strokes: int, execution_noise: ExecutionNoise, rng: np.random.Generator) -> Fault:
    """A random execution error for each stroke."""
    narrowing = 1 - execution_noise.thinning * rng.random((strokes, 1), dtype=np.float32)
    return Fault(narrowing, execution_noise.shift_m * rng.standard_normal((strokes, 1, 2), dtype=np.float32))


def render_plan(strokes: PlannedPaths, canvas: Array, scene: Scene, fault: Fault | None = None) -> Array:
    """The predicted canvas [H, W, 3] (linear light) after the strokes."""
    return render_and_back(strokes, canvas, scene, fault)[0]


def render_and_back(
    strokes: PlannedPaths, canvas: Array, scene: Scene, fault: Fault | None = None
) -> tuple[Array, Back]:
    """``render_plan`` and its pull-back. Inherited covariates are constants for the gradient."""
    if len(strokes) == 0:
        return canvas, lambda _: tuple(np.zeros_like(array) for array in strokes.arrays())
    marks, pull = strokes.marks(scene.brush, _inherited(strokes, scene))
    image, back = render_marks(marks, canvas, scene, fault)
    return image, lambda of_image: pull(back(of_image))


def render_marks(
    marks: Marks, canvas: Array, scene: Scene, fault: Fault | None = None
) -> tuple[Array, Callable[[Array], Marks]]:
    """The canvas with these marks on it, and the pull-back from an image's gradient to the marks'."""
    if fault is not None:
        marks = marks._replace(
            points_m=marks.points_m + fault.shift_m, radius_m=marks.radius_m * fault.narrowing
        )  # fmt: skip
    strokes = in_pixels(marks, scene).at(None)
    clean = marks.pickup is None
    ground = canvas if clean else np.concatenate([canvas, _wetness(scene)[..., None]], axis=-1)
    light, fragments = render(strokes, ground[None], threads=scene.threads)
    image = light[0, ..., :3] if scene.gain is None else light[0, ..., :3] * scene.gain
    below = None if clean else image < 0  # strong pickup can take more than there is
    if below is not None:
        image = np.maximum(image, np.float32(0.0))

    def back(of_image: Array) -> Marks:
        if below is not None:
            of_image = np.where(below, np.float32(0.0), of_image)
        if scene.gain is not None:
            of_image = of_image * scene.gain
        of_light = of_image if clean else np.concatenate([of_image, np.zeros_like(of_image[..., :1])], axis=-1)
        found = render_backward(strokes, fragments, of_light[None], threads=scene.threads)
        per_m = np.float32(scene.pixels_per_m)
        of_radius = found.radius[0] * per_m
        return Marks(
            found.points[0] * np.array([per_m, -per_m]),  # rows run down
            of_radius if fault is None else of_radius * fault.narrowing,
            found.density[0],
            found.softness[0],
            found.color[0],
            None if found.pickup is None else found.pickup[0],
        )

    return image, back


def marks_px(strokes: PlannedPaths, scene: Scene) -> PixelStrokes[Array]:
    """The marks of the strokes in the target's pixels."""
    marks, _ = strokes.marks(scene.brush, _inherited(strokes, scene))
    return in_pixels(marks, scene)


def coverages(strokes: PlannedPaths, scene: Scene, width_px: int) -> FloatArray:
    """[S, P] coverage of each pixel by each stroke alone, 0 to 1, in a picture ``width_px`` wide."""
    height, width = scene.target.shape[:2]
    factor = max(width / width_px, 1.0)
    shape = max(round(height / factor), 1), max(round(width / factor), 1)
    marks = marks_px(strokes, replace(scene, target=np.zeros((*shape, 3), np.float32)))
    white, black = np.ones((len(strokes), 3), np.float32), np.zeros((len(strokes), *shape, 3), np.float32)
    each = marks._replace(color=white, pickup=None).at((slice(None), None))  # a canvas for each
    alone, _ = render(each, black)
    return alone[..., 0].reshape(len(strokes), -1).astype(np.float64)


def in_pixels(marks: Marks, scene: Scene) -> PixelStrokes[Array]:
    """Marks in the target's pixels; see ``contracts.frames``."""
    per_m = np.float32(scene.pixels_per_m)
    column = marks.points_m[..., 0] * per_m - np.float32(0.5)
    row = (np.float32(scene.canvas_size_m[1]) - marks.points_m[..., 1]) * per_m - np.float32(0.5)
    points, radius = np.stack([column, row], axis=-1), marks.radius_m * per_m
    return PixelStrokes(points, radius, marks.density, marks.softness, marks.color, marks.pickup)


def _inherited(strokes: PlannedPaths, scene: Scene) -> Mapping[str, Array]:
    return inherit(strokes, scene) if strokes.inherited is None else strokes.inherited


def _wetness(scene: Scene) -> Array:
    """[H, W] 0 to 1: where the remembered canvas has paint when the plan begins."""
    height, width = scene.target.shape[:2]
    ink = scene.start.memory.ink.astype(np.float32)
    return np.asarray(cv2.resize(ink, (width, height), interpolation=cv2.INTER_LINEAR), dtype=np.float32)
