"""Where strokes start: at random (thesis 4.3.5), or where the picture still differs from the target.

Random starts leave parts of the picture without strokes (thesis 4.5): gradients move a stroke, but only over its own
width. A guided stroke is therefore the best of several candidates at one place of large error, each of them rendered.
"""

from __future__ import annotations

from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb, srgb_to_lab, srgb_to_linear
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.config import PlannerConfig
from pentimento.planning.strokes.paths import PlannedPaths
from pentimento.planning.strokes.render_plan import marks_px
from pentimento.planning.strokes.scene import Scene, inherit
from pentimento.render.strokes import PixelStrokes
from pentimento.render.strokewise import fall_with
from pentimento.robots.tools import Tool

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
S = TypeVar("S", bound=PlannedPaths)

_LOG_SPREAD = 0.6
"""Standard deviation of the logarithm of a candidate's length and press, relative to the round's."""
_TONE_POINTS = 7
"""Points of a path from whose inner ones a Bézier stroke takes its colour."""
HEADING_SPREAD_RAD = 0.15
"""Standard deviation of a candidate's heading about the target's edge."""


def random_strokes(count: int, tool: Tool, canvas_size_m: tuple[float, float], rng: np.random.Generator) -> Strokes:
    """Bézier strokes that are uniform over place, heading, length, press and colour."""
    return _straight_strokes(
        rng.uniform((0, 0), canvas_size_m, (count, 2)),
        rng.uniform(-np.pi, np.pi, count),
        rng.uniform(*tool.stroke_length_m, count),
        press_m=rng.uniform(*tool.press_range_m, count),
        color=rng.uniform(0, 1, (count, 3)),
    )


def guided_strokes(
    count: int, size: float, canvas: Array, scene: Scene, *, config: PlannerConfig, distances_px: tuple[int, ...],
    paints: FloatArray | None, rng: np.random.Generator,
) -> tuple[Strokes, FloatArray]:  # fmt: skip
    """Bézier strokes where the canvas [H, W, 3] (linear light) differs most from the target, along its edges.

    Args:
        size: 0 for the tool's shortest, lightest strokes, 1 for its longest and fullest.
        paints: see ``PathFamily.guided``.

    Returns:
        The strokes and their gains; see ``PathFamily.guided``.
    """
    tool, target = scene.tool, scene.target.astype(np.float64)
    k = scene.pixels_per_m
    wide_px = max(tool.nominal_width_m * k, 1.0)
    length: float = tool.stroke_length_m[0] + size * (tool.stroke_length_m[1] - tool.stroke_length_m[0]) * 0.7
    press: float = tool.press_range_m[0] + size * (tool.press_range_m[1] - tool.press_range_m[0]) * 0.8
    tone = tones(scene)
    wanted = error_map(canvas, scene)
    if config.initialisation == "saliency":
        wanted = wanted * saliency(target)
    middle, along = places_of_error(wanted, count, np.sqrt(length * k * wide_px) / 2, scene, rng)
    tried = _candidates(config.candidates, middle, along, length=length, press=press, tool=tool, rng=rng)
    tried.keep_within(tool, scene.canvas_size_m, config.edge_m)
    tried.color = tone_along(tried.paths(_TONE_POINTS), tone, scene, paints).astype(np.float32)
    # All candidates for one place have the same position in the plan.
    inherits = inherit(tried.pick(slice(0, count)), scene)
    tried.inherited = {name: np.tile(values, config.candidates) for name, values in inherits.items()}
    return best_of(tried, config.candidates, canvas, scene, distances_px)


def best_of(
    tried: S, tries: int, canvas: Array, scene: Scene, distances_px: tuple[int, ...]
) -> tuple[S, FloatArray]:  # fmt: skip
    """At each place the candidate that lowers the error most, and its gain [S].

    Args:
        tried: ``tries`` · S strokes: first one candidate for each of the S places, then another for each, and so on.
    """
    count = len(tried) // tries
    gains = fall_with(alone_px(tried, scene), canvas, scene.target, distances=distances_px).reshape(tries, count)
    chosen = tried.pick(gains.argmax(0) * count + np.arange(count))
    chosen.inherited = None  # they will have other positions in the plan
    return chosen, gains.max(0)


def alone_px(strokes: PlannedPaths, scene: Scene) -> PixelStrokes[Array]:
    """The strokes' marks in their own colours, as arguments of ``render.strokewise``'s functions.

    The camera's gain is left out. It acts on the whole picture, which these functions do not see.
    """
    return marks_px(strokes, scene)._replace(color=strokes.color, pickup=None)


def error_map(canvas: Array, scene: Scene) -> FloatArray:
    """[H, W] how far the canvas [H, W, 3] is from the target, both blurred to a quarter of the tool's width."""
    blur = max(scene.tool.nominal_width_m * scene.pixels_per_m, 1.0) / 4
    tone, wrong = (
        np.asarray(cv2.GaussianBlur(image.astype(np.float64), (0, 0), max(blur, 0.6)))
        for image in (scene.target, canvas)
    )  # fmt: skip
    return np.asarray(np.abs(np.sqrt(wrong) - np.sqrt(tone)).mean(-1) ** 2)


def places_of_error(
    error: FloatArray, count: int, apart_px: float, scene: Scene, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Places drawn in proportion to an error map [H, W], about ``apart_px`` from one another.

    Returns:
        Places [count, 2] on the canvas, metres, and the heading [count] of the target's edges there.
    """
    rows, columns = _places(error, count, apart_px, rng)
    k = scene.pixels_per_m
    middle = np.stack([(columns + 0.5) / k, scene.canvas_size_m[1] - (rows + 0.5) / k], axis=1)
    wide_px = max(scene.tool.nominal_width_m * k, 1.0)
    return middle, _edge_heading(np.sqrt(scene.target.astype(np.float64)), wide_px)[rows, columns]


def saliency(picture: FloatArray) -> FloatArray:
    """Frequency-tuned saliency (Achanta, Hemami, Estrada & Süsstrunk, CVPR 2009).

    Args:
        picture: [H, W, 3], linear light.

    Returns:
        [H, W], mean 1: the distance of each place's colour in L*a*b* from the picture's mean. 1 everywhere if flat.
    """
    soft = np.clip(np.asarray(cv2.GaussianBlur(picture, (5, 5), 0), dtype=np.float64), 0.0, 1.0)
    lab = srgb_to_lab(linear_to_srgb(soft))
    distance = np.linalg.norm(lab - lab.mean((0, 1)), axis=-1)
    mean = float(distance.mean())
    return np.asarray(distance / mean) if mean > 1e-6 else np.ones(picture.shape[:2])


def _candidates(
    tries: int, middle: FloatArray, along: FloatArray, *, length: float, press: float, tool: Tool,
    rng: np.random.Generator,
) -> Strokes:  # fmt: skip
    """``tries`` candidates for each place. Two of three run along the edge there; one of two has any press.

    The latter reaches places outside the range of a path, such as the canvas's rim.
    """
    shape = (tries, len(along))
    number = np.arange(tries)[:, None]
    heading = np.where(
        number % 3 == 2, rng.uniform(-np.pi, np.pi, shape), along + rng.normal(0, HEADING_SPREAD_RAD, shape)
    )
    lengths = np.clip(length * np.exp(rng.normal(-0.1, _LOG_SPREAD, shape)), *tool.stroke_length_m)
    fitting = np.clip(press * np.exp(rng.normal(-0.1, _LOG_SPREAD, shape)), *tool.press_range_m)
    presses = np.where(number % 2 == 1, rng.uniform(*tool.press_range_m, shape), fitting)
    aside = 0.15 * length * (number > 0)[..., None] * rng.normal(0, 1, (*shape, 2))
    places = (middle + aside).reshape(-1, 2)
    return _straight_strokes(
        places, heading.ravel(), lengths.ravel(), press_m=presses.ravel(), color=np.zeros((heading.size, 3))
    )  # fmt: skip


def tones(scene: Scene) -> FloatArray:
    """The target's colours at the scale of a stroke, linear light [H, W, 3]."""
    wide_px = max(scene.tool.nominal_width_m * scene.pixels_per_m, 1.0)
    target = scene.target.astype(np.float64)
    return np.asarray(cv2.GaussianBlur(target, (0, 0), max(wide_px / 4, 0.6)), dtype=np.float64)


def tone_along(paths: Array, tone: FloatArray, scene: Scene, paints: FloatArray | None) -> FloatArray:
    """[S, 3] mean colour of ``tone`` under each path [S, N, 5], linear light; the nearest paint where there are paints.

    A tool with its own ink has that colour.
    """
    if scene.tool.color_srgb is not None:
        ink = srgb_to_linear(np.array(scene.tool.color_srgb, dtype=np.float64))
        return np.zeros((len(paths), 3)) + ink
    path = paths[:, 1:-1, 1:3]
    height, width = tone.shape[:2]
    k = scene.pixels_per_m
    columns = np.clip(path[..., 0] * k, 0, width - 1).astype(int)
    rows = np.clip((scene.canvas_size_m[1] - path[..., 1]) * k, 0, height - 1).astype(int)
    root = np.sqrt(np.clip(tone[rows, columns], 0.0, 1.0)).mean(1)
    if paints is None:
        return np.asarray(root**2)
    nearest = np.square(root[:, None] - np.sqrt(paints)).sum(-1).argmin(1)
    return np.asarray(paints[nearest])


def _places(error: FloatArray, count: int, apart_px: float, rng: np.random.Generator) -> tuple[IntArray, IntArray]:
    """Rows and columns drawn in proportion to the error. Each place lowers the error around it for the next."""
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


def _straight_strokes(
    middle_m: FloatArray, theta_rad: FloatArray, length_m: FloatArray, *, press_m: FloatArray, color: FloatArray
) -> Strokes:
    presses = np.repeat(press_m[:, None], 3, axis=1)
    arrays = (middle_m, theta_rad, length_m, np.zeros(len(theta_rad)), presses, color)
    return Strokes(*(array.astype(np.float32) for array in arrays))
