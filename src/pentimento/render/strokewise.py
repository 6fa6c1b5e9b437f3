"""Effect of single strokes on an error: laid alone on a canvas, or left out of a painting. Compiled.

Strokes are composited in linear light, so a stroke's share in a pixel's light is known from its fragment there, without
another rendering. Laid alone, it changes the light by a (colour − canvas). Left out of a painting, it changes it by

    Π (1 − a_j) · a (below − colour)      over the strokes j above it

which one pass from the last fragment to the first computes for all strokes. The error is the squared difference of
lightness from a target, averaged over viewing distances and channels and summed over pixels. Lightness is the square
root of the light averaged over squares of ``distance`` pixels, an approximation of sRGB's curve. Beyond the canvas's
edge it is 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.render.coverage import compiled
from pentimento.render.errors import RenderInputError
from pentimento.render.forward import Fragments, lay_band, reach_of_strokes
from pentimento.render.kernel import check_inputs
from pentimento.render.strokes import PixelStrokes

Array = NDArray[Any]


def rise_without(strokes: PixelStrokes[Array], canvas: Array, target: Array, *, distances: tuple[int, ...]) -> Array:
    """[S] rise of the painting's error when a stroke is left out. Negative where the stroke does harm.

    Args:
        strokes: of one canvas; their tools stay clean, whatever ``pickup`` says.
        canvas: float[H, W, 3], linear light, before the first stroke. It is not changed.
        target: float[H, W, 3], linear light.
        distances: viewing distances [px], each 1 or more.

    Raises:
        RenderInputError: ``render`` refuses the strokes or the canvas, or the target differs from the canvas in shape
            or precision.
    """
    _check(strokes, canvas, target)
    image = canvas.copy()
    laid = _lay(strokes, image)
    change = _left_out(
        laid.start, laid.column, laid.row, laid.coverage, laid.below, strokes.color, *canvas.shape[:2]
    )  # fmt: skip
    return _mean_rise(laid, change, image, target=target, distances=distances)


def fall_with(strokes: PixelStrokes[Array], canvas: Array, target: Array, *, distances: tuple[int, ...]) -> Array:
    """[S] fall of the canvas's error when a stroke alone is laid on it; see ``rise_without``."""
    _check(strokes, canvas, target)
    laid = _lay(strokes, canvas.copy())
    change = _laid_alone(laid.start, laid.column, laid.row, laid.coverage, strokes.color, canvas)
    return -_mean_rise(laid, change, canvas, target=target, distances=distances)


def _check(strokes: PixelStrokes[Array], canvas: Array, target: Array) -> None:
    check_inputs(strokes._replace(pickup=None).at(None), canvas[None], threads=1)
    if target.shape != canvas.shape or target.dtype != canvas.dtype:
        raise RenderInputError(
            f"A canvas of {canvas.shape}, {canvas.dtype}, is compared with a target of {target.shape}, {target.dtype}: "
            "give both the same size and precision."
        )


def _lay(strokes: PixelStrokes[Array], image: Array) -> Fragments:
    """The fragments of strokes laid on ``image``, in place, as one band."""
    reach, clean = reach_of_strokes(strokes.points, strokes.radius), np.empty(0, image.dtype)
    *own, _ = strokes
    return Fragments(0, *lay_band(*own, clean, reach, image, 0))


def _mean_rise(laid: Fragments, change: Array, image: Array, *, target: Array, distances: tuple[int, ...]) -> Array:
    start, column, row = laid.start, laid.column, laid.row
    total = np.zeros(len(start) - 1)
    for distance in distances:
        seen, wanted = _seen(image, distance), _seen(target, distance)
        rise = _rise_at_once if distance == 1 else _rise_from_afar
        total += rise(start, column, row, change, seen, np.sqrt(seen), np.sqrt(wanted), distance)
    return np.asarray(total / (3 * len(distances)))


@compiled
def _left_out(
    start: Array, column: Array, row: Array, coverage: Array, below: Array, color: Array, height: int, width: int
) -> Array:
    """[F, 3] change of the painting's light at each fragment when its stroke is left out."""
    shown = np.ones((height, width), coverage.dtype)
    change = np.empty((start[-1], 3), coverage.dtype)
    one = coverage.dtype.type(1.0)
    for s in range(len(start) - 2, -1, -1):
        for f in range(start[s], start[s + 1]):
            a, left = coverage[f], shown[row[f], column[f]]
            for i in range(3):
                change[f, i] = left * a * (below[f, i] - color[s, i])
            shown[row[f], column[f]] = left * (one - a)
    return change


@compiled
def _laid_alone(start: Array, column: Array, row: Array, coverage: Array, color: Array, canvas: Array) -> Array:
    """[F, 3] change of the canvas's light at each fragment when its stroke alone is laid on it."""
    change = np.empty((start[-1], 3), coverage.dtype)
    for s in range(len(start) - 1):
        for f in range(start[s], start[s + 1]):
            for i in range(3):
                change[f, i] = coverage[f] * (color[s, i] - canvas[row[f], column[f], i])
    return change


@compiled
def _seen(image: Array, distance: int) -> Array:
    """[H, W, 3] light averaged over the square around each pixel, 0 beyond the edge."""
    height, width, _ = image.shape
    before, share = distance // 2, image.dtype.type(1.0 / (distance * distance))
    seen = np.zeros_like(image)
    across = np.zeros_like(image)
    for r in range(height):
        for j in range(-before, distance - before):
            for c in range(max(-j, 0), min(width - j, width)):
                for i in range(3):
                    across[r, c, i] += image[r, c + j, i]
    for r in range(height):
        for k in range(max(r - before, 0), min(r - before + distance, height)):
            for c in range(width):
                for i in range(3):
                    seen[r, c, i] += share * across[k, c, i]
    return np.maximum(seen, image.dtype.type(0.0))


@compiled
def _rise_at_once(
    start: Array, column: Array, row: Array, change: Array, seen: Array, now: Array, wanted: Array, _distance: int
) -> Array:
    """[S] rise of the error, summed over pixels and channels, at a viewing distance of one pixel."""
    zero = seen.dtype.type(0.0)
    rise = np.zeros(len(start) - 1)
    for s in range(len(start) - 1):
        total = zero
        for f in range(start[s], start[s + 1]):
            r, c = row[f], column[f]
            for i in range(3):
                then = np.sqrt(max(seen[r, c, i] + change[f, i], zero))
                was, goal = now[r, c, i], wanted[r, c, i]
                total += (then - was) * (then + was - goal - goal)
        rise[s] = total
    return rise


@compiled
def _rise_from_afar(
    start: Array, column: Array, row: Array, change: Array, seen: Array, now: Array, wanted: Array, distance: int
) -> Array:
    """``_rise_at_once`` for larger viewing distances: each stroke's changes are averaged over squares.

    ``laid`` holds one stroke's changes, three numbers a pixel, with a margin of ``distance`` around the canvas.
    """
    height, width, _ = seen.shape
    zero, share = seen.dtype.type(0.0), seen.dtype.type(1.0 / (distance * distance))
    after = distance - 1 - distance // 2
    laid = np.zeros((height + 2 * distance, 3 * (width + 2 * distance)), seen.dtype)
    down = np.zeros(laid.shape[1], seen.dtype)
    seen_rows, now_rows = seen.reshape(height, 3 * width), now.reshape(height, 3 * width)
    wanted_rows = wanted.reshape(height, 3 * width)
    rise = np.zeros(len(start) - 1)
    for s in range(len(start) - 1):
        if start[s] == start[s + 1]:
            continue
        r0, r1, c0, c1 = height, 0, width, 0
        for f in range(start[s], start[s + 1]):
            r, c = row[f], column[f]
            r0, r1, c0, c1 = min(r0, r), max(r1, r), min(c0, c), max(c1, c)
            for i in range(3):
                laid[r + distance, 3 * (c + distance) + i] = change[f, i]
        total = zero
        first, end = 3 * max(c0 - after, 0), 3 * min(c1 + distance // 2 + 1, width)
        for r in range(max(r0 - after, 0), min(r1 + distance // 2 + 1, height)):
            top = r + distance - distance // 2
            down[first : end + 6 * distance] = zero
            for k in range(top, top + distance):
                for x in range(first, end + 6 * distance):
                    down[x] += laid[k, x]
            for x in range(first, end):
                spread = zero
                for j in range(distance):
                    spread += down[x + 3 * (distance - distance // 2 + j)]
                then = np.sqrt(max(seen_rows[r, x] + share * spread, zero))
                was, goal = now_rows[r, x], wanted_rows[r, x]
                total += (then - was) * (then + was - goal - goal)
        rise[s] = total
        for f in range(start[s], start[s + 1]):
            for i in range(3):
                laid[row[f] + distance, 3 * (column[f] + distance) + i] = zero
    return rise
