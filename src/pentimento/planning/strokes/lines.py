"""Strokes along the lines of a target, for a tool with its own ink: lines are drawn, not hatched.

What is to be inked is thinned to lines of one pixel. A walk follows each line straight across its crossings, and is cut
into the longest pieces that a Bézier stroke fits.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import srgb_to_linear
from pentimento.contracts.errors import ConfigError
from pentimento.planning.strokes.bezier import Strokes, no_strokes
from pentimento.planning.strokes.scene import Scene

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

_ENLARGED: Final = 3  # lines are 2 or 3 px wide: thinned at this many times the resolution
_INKED: Final = 0.4  # of the lightness: how much darker than the canvas a target is where ink is missing
_FIT: Final = 0.3  # of the tool's width: largest distance of a line from the stroke that draws it
_SPUR: Final = 1.0  # of the tool's width: shorter lines that thinning leaves are no lines
_TURN_PX: Final = 6  # of the walk behind a crossing, which its direction is taken from
_SHORTER: Final = 0.92  # factor of the length that is tried next
_PRESS: Final = 0.5  # of the tool's range, at the start of a plan
_NEIGHBOURS: Final = ((-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1))


@dataclass(frozen=True)
class _Arc:
    """A Bézier stroke's geometry, canvas frame."""

    middle_m: FloatArray
    """[2]."""
    theta_rad: float
    length_m: float
    bend_m: float


def line_strokes(count: int, canvas: Array, scene: Scene) -> Strokes:
    """At most `count` strokes along the lines that a canvas [H, W, 3] (linear light) lacks; the longest lines first.

    Raises:
        ConfigError: the tool takes paints.
    """
    tool, k = scene.tool, scene.pixels_per_m
    if tool.color_srgb is None:
        raise ConfigError(f"The {tool.name} takes paints; plans that start along lines need a tool with its own ink.")
    missing = (np.sqrt(canvas) - np.sqrt(scene.target)).mean(-1).astype(np.float32)
    size = (missing.shape[1] * _ENLARGED, missing.shape[0] * _ENLARGED)
    inked = cv2.resize(missing, size, interpolation=cv2.INTER_CUBIC) > _INKED
    height_m, wide_m = scene.canvas_size_m[1], tool.nominal_width_m
    arcs: list[_Arc] = []
    for walk in walks(thinned(inked)):
        points = np.stack([walk[:, 1] + 0.5, walk[:, 0] + 0.5], axis=1) / (k * _ENLARGED)
        points[:, 1] = height_m - points[:, 1]
        if np.linalg.norm(np.ptp(points, axis=0)) >= _SPUR * wide_m:
            arcs += _pieces(_smooth(points), tool.stroke_length_m[1], tool.bend_range, _FIT * wide_m)
    arcs = sorted(arcs, key=lambda arc: -arc.length_m)[:count]
    if not arcs:
        return no_strokes()
    press = tool.press_range_m[0] + _PRESS * (tool.press_range_m[1] - tool.press_range_m[0])
    ink = srgb_to_linear(np.array(tool.color_srgb, dtype=np.float64))
    arrays = (
        np.array([arc.middle_m for arc in arcs]), np.array([arc.theta_rad for arc in arcs]),
        np.array([arc.length_m for arc in arcs]), np.array([arc.bend_m for arc in arcs]),
        np.full((len(arcs), 3), press), np.tile(ink, (len(arcs), 1)),
    )  # fmt: skip
    return Strokes(*(array.astype(np.float32) for array in arrays))


def thinned(mask: Mask) -> Mask:
    """The mask's lines, one pixel wide (Zhang and Suen 1984): the border is removed as long as nothing is cut."""
    inside = np.pad(mask, 1).astype(np.uint8)
    while True:
        before = int(inside.sum())
        for half in (0, 1):
            around = np.stack([np.roll(inside, (-dy, -dx), (0, 1)) for dy, dx in _NEIGHBOURS])
            number = around.sum(0)
            cuts = ((around == 0) & (np.roll(around, -1, 0) == 1)).sum(0)
            north, east, south, west = around[0], around[2], around[4], around[6]
            one = north * east * south if half == 0 else north * east * west
            other = east * south * west if half == 0 else north * south * west
            inside[(inside == 1) & (number >= 2) & (number <= 6) & (cuts == 1) & (one == 0) & (other == 0)] = 0
        if int(inside.sum()) == before:
            return inside[1:-1, 1:-1] > 0


def walks(lines: Mask) -> Iterator[FloatArray]:
    """Walks along thin lines, [N, 2] rows and columns each, that together visit each pixel once; first from line ends.

    At a crossing, a walk goes on as straight as possible.
    """
    left = {(int(r), int(c)) for r, c in np.argwhere(lines)}

    def near(place: tuple[int, int]) -> list[tuple[int, int]]:
        return [p for dy, dx in _NEIGHBOURS if (p := (place[0] + dy, place[1] + dx)) in left]

    ends = sorted(place for place in left if len(near(place)) == 1)
    for start in [*ends, *sorted(left)]:
        if start not in left:
            continue
        left.discard(start)
        walk = [start]
        while candidates := near(walk[-1]):
            behind = walk[-min(_TURN_PX, len(walk))]
            heading = np.subtract(walk[-1], behind)
            steps = np.subtract(candidates, walk[-1])
            ahead = steps @ heading / np.linalg.norm(steps, axis=1)
            walk.append(candidates[int(ahead.argmax())])
            left.discard(walk[-1])
        yield np.array(walk, dtype=np.float64)


def _smooth(points: FloatArray) -> FloatArray:
    """A path [N, 2] without the steps of its pixels; its ends stay."""
    if len(points) < 3:
        return points
    reach = min(_ENLARGED, (len(points) - 1) // 2)
    padded = np.pad(points, ((reach, reach), (0, 0)), mode="reflect", reflect_type="odd")
    window = np.ones(2 * reach + 1) / (2 * reach + 1)
    return np.stack([np.convolve(padded[:, axis], window, mode="valid") for axis in (0, 1)], axis=1)


def _pieces(points: FloatArray, longest_m: float, bend_range: tuple[float, float], fit_m: float) -> list[_Arc]:
    """A path [N, 2] cut into the longest pieces that strokes fit within `fit_m`."""
    arcs, start = [], 0
    while start < len(points) - 1:
        size = len(points) - start
        while True:
            arc = _arc(points[start : start + size], longest_m, bend_range, fit_m if size > 2 else np.inf)
            if arc is not None:
                break
            size = max(2, min(size - 1, int(size * _SHORTER)))
        arcs.append(arc)
        start += size - 1
    return arcs


def _arc(points: FloatArray, longest_m: float, bend_range: tuple[float, float], fit_m: float) -> _Arc | None:
    """The stroke from the first to the last point, or None if it is too long, too bent or too far from the others."""
    chord = points[-1] - points[0]
    length = float(np.linalg.norm(chord))
    if not 0 < length <= longest_m:
        return None
    forward = chord / length
    offset = points - points[0]
    along = offset @ forward / length
    across = offset @ np.array([-forward[1], forward[0]])
    shape = 3 * along * (1 - along)
    bend = float(shape @ across / max(float(shape @ shape), 1e-12))
    beyond = max(-along.min(), along.max() - 1) * length
    far = max(float(np.abs(across - bend * shape).max()), beyond) > fit_m
    if far or not bend_range[0] * length <= bend <= bend_range[1] * length:
        if np.isfinite(fit_m):
            return None
        bend = 0.0
    return _Arc((points[0] + points[-1]) / 2, float(np.arctan2(chord[1], chord[0])), length, bend)
