"""Forward pass: strokes composited in order onto one band of a canvas's rows, with a record of the ground."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.render.composition import compose, compose_carrying
from pentimento.render.coverage import (
    FAR,
    HALF_PX,
    LANES,
    R_MIN,
    SEGMENT_FIELDS,
    compiled,
    cover,
    describe_segments,
    is_constant,
)

Array = NDArray[Any]


class Fragments(NamedTuple):
    """Fragments in a band of rows, by stroke, then by row. F fragments, C channels.

    The lists are LANES longer than F, so that they can be read in whole blocks.
    """

    top: int
    """The canvas row of the band's first row."""
    start: Array
    """int64[S + 1]: stroke s has the fragments start[s]:start[s + 1]."""
    column: Array
    """uint16[F + LANES]"""
    row: Array
    """uint16[F + LANES], of the band."""
    segment: Array
    """uint16[F + LANES]: the segment that covers the pixel."""
    coverage: Array
    """float[F + LANES]"""
    below: Array
    """float[F + LANES, C]: the canvas before the stroke."""
    evaluations: int
    """Number of evaluated pixel-segment pairs."""


@compiled
def reach_of_strokes(points: Array, radius: Array) -> Array:
    """float64[S, 3] of strokes [S, N, 2]: first and last row with possible ink, and the approximate area in pixels."""
    reach = np.empty((points.shape[0], 3))
    for s in range(points.shape[0]):
        low, high, widest = points[s, 0, 1], points[s, 0, 1], max(radius[s, 0], points.dtype.type(R_MIN))
        length = 0.0
        for i in range(1, points.shape[1]):
            low, high, widest = min(low, points[s, i, 1]), max(high, points[s, i, 1]), max(widest, radius[s, i])
            length += np.hypot(points[s, i, 0] - points[s, i - 1, 0], points[s, i, 1] - points[s, i - 1, 1])
        wide = np.float64(widest) + HALF_PX
        reach[s, 0], reach[s, 1] = low - wide, high + wide
        reach[s, 2] = (2 * length + 4 * wide) * wide
    return reach


@compiled
def expected_fragments(reach: Array, top: int, rows: int, width: int) -> int:
    """An estimate from above of the number of fragments in the rows top:top + rows.

    Memory that is never written to costs nothing; reallocation does.
    """
    room = 0.0
    for s in range(reach.shape[0]):
        low, high = max(reach[s, 0], top), min(reach[s, 1], top + rows)
        if high > low:
            share = (high - low) / (reach[s, 1] - reach[s, 0])
            room += min(1.3 * share * reach[s, 2], (high - low + 1) * width)
    return int(room)


@compiled
def lay_band(
    points: Array,
    radius: Array,
    density: Array,
    softness: Array,
    color: Array,
    pickup: Array,
    reach: Array,
    image: Array,
    top: int,
) -> tuple[Array, Array, Array, Array, Array, Array, int]:
    """Composite strokes onto ``image`` [rows, W, C], in place; return the fields of ``Fragments`` after ``top``.

    ``reach`` is the result of ``reach_of_strokes``. ``pickup`` [S] is empty where C = 3.
    """
    n_strokes, n_points, _ = points.shape
    rows, width, channels = image.shape
    columns = np.arange(width + LANES).astype(points.dtype)
    rank = np.full((rows, width + LANES), points.dtype.type(FAR))
    thickness = np.zeros_like(rank)
    winner = np.zeros((rows, width + LANES), np.int32)
    left, right = np.full(rows, width, np.int32), np.zeros(rows, np.int32)
    segments = np.empty((max(n_points - 1, 1), SEGMENT_FIELDS), points.dtype)
    carried = np.empty((segments.shape[0], 4), points.dtype)
    start = np.zeros(n_strokes + 1, np.int64)
    room = expected_fragments(reach, top, rows, width) + LANES
    column, row, segment = np.empty(room, np.uint16), np.empty(room, np.uint16), np.empty(room, np.uint16)
    coverage, below = np.empty(room, points.dtype), np.empty((room, channels), points.dtype)
    count, evaluations = 0, 0
    for s in range(n_strokes):
        start[s + 1] = count
        if reach[s, 1] < top or reach[s, 0] > top + rows:
            continue
        describe_segments(points[s], radius[s], density[s], softness[s], segments)
        constant = is_constant(density[s]) and is_constant(softness[s])
        r0, r1, evaluated = cover(segments, constant, columns, rank, thickness, winner, left, right, top, width)
        evaluations += evaluated
        needed = count + LANES
        for r in range(r0, r1):
            needed += max(right[r] - left[r], 0)
        if needed > room:
            room = max(needed, 2 * room)
            column, row, segment = _longer(column, room), _longer(row, room), _longer(segment, room)
            coverage, below = _longer(coverage, room), _longer(below, room)
        first = count
        for r in range(r0, r1):
            ranks, winners = rank[r], winner[r]
            for c in range(left[r], right[r]):  # a pixel without ink is overwritten by the next, which avoids a branch
                column[count], row[count], segment[count], coverage[count] = c, r, winners[c], -ranks[c]
                count += ranks[c] < 1
            ranks[left[r] : right[r] + LANES] = FAR
            left[r], right[r] = width, 0
        start[s + 1] = count
        if channels == 4:
            compose_carrying(color[s], pickup[s], column, row, segment, coverage, below, first, count, image, carried)
        else:
            compose(color[s], column, row, coverage, below, first, count, image)
    for f in range(count, count + LANES):  # read with the last block, never used
        column[f], row[f], segment[f], coverage[f] = 0, 0, 0, 0
    return start, column, row, segment, coverage, below, evaluations


@compiled
def _longer(old: Array, room: int) -> Array:
    new = np.empty((room, *old.shape[1:]), old.dtype)
    new[: old.shape[0]] = old
    return new
