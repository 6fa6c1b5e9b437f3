"""Where strokes start: at random (thesis 4.3.5), or where the picture still differs from the target.

The thesis names what is wrong with the former: where few strokes start, none will come. A guided stroke is the best of
several candidates at its place, each rendered: gradients move a stroke, they never turn a bad idea into another one.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb, srgb_to_lab, srgb_to_linear
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.config import PlannerConfig
from pentimento.planning.strokes.render_plan import marks_px
from pentimento.planning.strokes.scene import Scene, inherit
from pentimento.render.strokewise import fall_with
from pentimento.robots.tools import Tool

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_SPREAD = 0.6
"""Of a candidate's length and press about the round's, as a standard deviation of their logarithm."""


def random_strokes(count: int, tool: Tool, canvas_size_m: tuple[float, float], rng: np.random.Generator) -> Strokes:
    """Uniform over place, heading, shape, press and colour."""
    return _strokes(
        rng.uniform((0, 0), canvas_size_m, (count, 2)),
        rng.uniform(-np.pi, np.pi, count),
        rng.uniform(*tool.stroke_length_m, count),
        rng.uniform(*tool.press_range_m, count),
        rng.uniform(0, 1, (count, 3)),
    )


def guided_strokes(
    count: int,
    size: float,
    canvas: Array,
    scene: Scene,
    config: PlannerConfig,
    paints: FloatArray | None,
    rng: np.random.Generator,
) -> tuple[Strokes, FloatArray]:
    """Strokes laid where the canvas differs most from the target, along the target's edges, in its colours.

    Args:
        size: 0 for the tool's shortest, lightest strokes, 1 for its longest and fullest.
        canvas: [H, W, 3], linear light: what they are laid upon.
        paints: [K, 3], linear light: the only colours to take, or None for any.

    Returns:
        The strokes, and by how much each of them alone lowers the error, summed over pixels.
    """
    tool, target = scene.tool, scene.target.astype(np.float64)
    k = scene.pixels_per_m
    wide_px = max(tool.nominal_width_m * k, 1.0)
    length: float = tool.stroke_length_m[0] + size * (tool.stroke_length_m[1] - tool.stroke_length_m[0]) * 0.7
    press: float = tool.press_range_m[0] + size * (tool.press_range_m[1] - tool.press_range_m[0]) * 0.8
    tone = np.asarray(cv2.GaussianBlur(target, (0, 0), max(wide_px / 4, 0.6)), dtype=np.float64)
    wanted = error_map(canvas, scene)
    if config.initialisation == "saliency":
        wanted = wanted * saliency(target)
    middle, along = places_of_error(wanted, count, np.sqrt(length * k * wide_px) / 2, scene, rng)
    candidates = _candidates(config.candidates, middle, along, length, press, tool, rng)
    candidates.keep_within(tool, scene.canvas_size_m, config.edge_m)
    candidates.color = _tone_along(candidates, tone, scene, paints).astype(np.float32)
    # All candidates for one place would stand at the same place of the plan.
    inherits = inherit(candidates.pick(slice(0, count)), scene)
    candidates.inherited = {name: np.tile(values, config.candidates) for name, values in inherits.items()}
    gains = fall_with(*stroke_arrays(candidates, canvas, scene, config)).reshape(config.candidates, count)
    best = np.argmax(gains, axis=0)
    chosen = candidates.pick(best * count + np.arange(count))
    chosen.inherited = None  # they stand elsewhere when they are added
    return chosen, np.max(gains, axis=0)


def error_map(canvas: Array, scene: Scene) -> FloatArray:
    """[H, W] how far the canvas [H, W, 3] is from the target, seen as blurred as the tool's width makes it."""
    blur = max(scene.tool.nominal_width_m * scene.pixels_per_m, 1.0) / 4
    tone, wrong = (
        np.asarray(cv2.GaussianBlur(image.astype(np.float64), (0, 0), max(blur, 0.6)))
        for image in (scene.target, canvas)
    )  # fmt: skip
    return np.asarray(np.abs(np.sqrt(wrong) - np.sqrt(tone)).mean(-1) ** 2)


def places_of_error(
    error: FloatArray, count: int, apart_px: float, scene: Scene, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """``count`` places [count, 2] on the canvas, metres, drawn in proportion to the error, apart from one another;
    and the heading [count] of the target's edges there.
    """
    rows, columns = _places(error, count, apart_px, rng)
    k = scene.pixels_per_m
    middle = np.stack([(columns + 0.5) / k, scene.canvas_size_m[1] - (rows + 0.5) / k], axis=1)
    wide_px = max(scene.tool.nominal_width_m * k, 1.0)
    return middle, _edge_heading(np.sqrt(scene.target.astype(np.float64)), wide_px)[rows, columns]


def stroke_arrays(strokes: Strokes, canvas: Array, scene: Scene, config: PlannerConfig) -> tuple[Any, ...]:
    """The arguments of ``render.strokewise``'s functions: marks, colours, canvas, target and viewing distances.

    Colours are as planned, without what a camera makes of them: its effect on the whole picture is left out here, too,
    and one without the other misleads.
    """
    points, radius, marks = marks_px(strokes, scene)
    return (
        points, radius, marks.density, marks.softness, strokes.color, canvas, scene.target, config.distances_px,
    )  # fmt: skip


def _candidates(
    tries: int,
    middle: FloatArray,
    along: FloatArray,
    length: float,
    press: float,
    tool: Tool,
    rng: np.random.Generator,
) -> Strokes:
    """``tries`` times one stroke at each place: of three, two along the edge there; of two, one pressed as hard as
    chance has it.

    The latter reaches what is beside a path's own range, such as the canvas's rim.
    """
    shape = (tries, len(along))
    number = np.arange(tries)[:, None]
    heading = np.where(number % 3 == 2, rng.uniform(-np.pi, np.pi, shape), along + rng.normal(0, 0.15, shape))
    lengths = np.clip(length * np.exp(rng.normal(-0.1, _SPREAD, shape)), *tool.stroke_length_m)
    fitting = np.clip(press * np.exp(rng.normal(-0.1, _SPREAD, shape)), *tool.press_range_m)
    presses = np.where(number % 2 == 1, rng.uniform(*tool.press_range_m, shape), fitting)
    beside = 0.15 * length * (number > 0)[..., None] * rng.normal(0, 1, (*shape, 2))
    flat = (heading.ravel(), lengths.ravel(), presses.ravel())
    return _strokes((middle + beside).reshape(-1, 2), *flat, np.zeros((heading.size, 3)))


def _tone_along(strokes: Strokes, tone: FloatArray, scene: Scene, paints: FloatArray | None) -> FloatArray:
    """[S, 3] mean colour of ``tone`` under each stroke, linear light; the nearest paint, where there are paints."""
    if scene.tool.color_srgb is not None:
        return np.zeros((len(strokes), 3)) + _own_ink(scene.tool)
    path = strokes.paths(7)[:, 1:-1, 1:3]
    height, width = tone.shape[:2]
    k = scene.pixels_per_m
    columns = np.clip(path[..., 0] * k, 0, width - 1).astype(int)
    rows = np.clip((scene.canvas_size_m[1] - path[..., 1]) * k, 0, height - 1).astype(int)
    root = np.sqrt(np.clip(tone[rows, columns], 0.0, 1.0)).mean(1)
    if paints is None:
        return np.asarray(root**2)
    nearest = np.square(root[:, None] - np.sqrt(paints)).sum(-1).argmin(1)
    return np.asarray(paints[nearest])


def _own_ink(tool: Tool) -> FloatArray:
    return srgb_to_linear(np.array(tool.color_srgb, dtype=np.float64))


def _places(error: FloatArray, count: int, apart_px: float, rng: np.random.Generator) -> tuple[IntArray, IntArray]:
    """Rows and columns drawn in proportion to the error, each place taken lowering the error around it."""
    left = error + 1e-4 * error.mean() + 1e-12
    reach = int(3 * apart_px) + 1
    offsets = np.arange(-reach, reach + 1)
    dent = 1 - 0.9 * np.exp(-(offsets[:, None] ** 2 + offsets**2) / (2 * apart_px**2))
    rows, columns = np.empty(count, np.int64), np.empty(count, np.int64)
    of_rows = left.sum(1)
    for i in range(count):
        r = _drawn(of_rows, rng)
        c = _drawn(left[r], rng)
        rows[i], columns[i] = r, c
        top, side = max(r - reach, 0), max(c - reach, 0)
        near = left[top : r + reach + 1, side : c + reach + 1]
        near *= dent[top - r + reach :, side - c + reach :][: near.shape[0], : near.shape[1]]
        of_rows[top : r + reach + 1] = left[top : r + reach + 1].sum(1)
    return rows, columns


def _drawn(weights: FloatArray, rng: np.random.Generator) -> int:
    """An index, drawn in proportion to the weights."""
    total = np.cumsum(weights)
    return min(int(np.searchsorted(total, rng.uniform(0, total[-1]))), len(weights) - 1)


def _edge_heading(tone: FloatArray, scale_px: float) -> FloatArray:
    """[H, W] heading along the strongest edges nearby, canvas frame (y up), from the structure tensor."""
    grey = tone.mean(-1)
    right, down = cv2.Sobel(grey, cv2.CV_64F, 1, 0), cv2.Sobel(grey, cv2.CV_64F, 0, 1)
    xx, yy, xy = (cv2.GaussianBlur(p, (0, 0), scale_px) for p in (right * right, down * down, right * down))
    steepest = 0.5 * np.arctan2(2 * xy, xx - yy)
    return -(steepest + np.pi / 2)


def _strokes(
    middle_m: FloatArray, theta_rad: FloatArray, length_m: FloatArray, press_m: FloatArray, color: FloatArray
) -> Strokes:
    presses = np.repeat(press_m[:, None], 3, axis=1)
    arrays = (middle_m, theta_rad, length_m, np.zeros(len(theta_rad)), presses, color)
    return Strokes(*(array.astype(np.float32) for array in arrays))


def saliency(picture: FloatArray) -> FloatArray:
    """[H, W], mean 1: how far each place's colour in L*a*b* is from the picture's mean; 1 everywhere in a flat one.

    Args:
        picture: [H, W, 3], linear light.
    """
    soft = np.clip(np.asarray(cv2.GaussianBlur(picture, (5, 5), 0), dtype=np.float64), 0.0, 1.0)
    lab = srgb_to_lab(linear_to_srgb(soft))
    distance = np.linalg.norm(lab - lab.mean((0, 1)), axis=-1)
    mean = float(distance.mean())
    return np.asarray(distance / mean) if mean > 1e-6 else np.ones(picture.shape[:2])
