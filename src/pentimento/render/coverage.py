"""Coverage of pixels by one stroke: rows of pixels against segments, several columns at once.

For each segment only the pixels within its reach are evaluated, in blocks of ``LANES`` columns that the compiler turns
into vector instructions. A block may extend beyond the reach, where the formula gives no coverage.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pentimento.render.fastmath import exp2, log2

R_MIN = 0.05
"""Floor under the radius [px]."""
HALF_PX = 0.5
"""Half a pixel's side [px]: ink falls up to so far beyond the radius."""
RIM_PX = 0.25
"""Floor under R − D in the profile [px]. The profile is not resolved within the pixels of the rim, and the slope of
(1 − D/R)^c stays finite there for c < 1."""
FAR = 1e30
"""Rank of a pixel that no segment has reached."""
LENGTH_EPSILON = 1e-12
"""Floor under a segment's squared length [px²]."""
LANES = 16
"""Columns evaluated at once. The compiler unrolls a loop of 8 before it can vectorise it."""
SEGMENT_FIELDS = 11

Array = NDArray[Any]
compiled = njit(cache=True, fastmath=True, error_model="numpy", boundscheck=False, nogil=True)
inlined = njit(forceinline=True, fastmath=True, error_model="numpy", boundscheck=False, nogil=True)
"""For functions called once per few pixels: passing arrays to a function costs more than a block of pixels."""


@compiled
def is_constant(values: Array) -> bool:
    """Whether all values are equal."""
    same = True
    for value in values:
        same &= value == values[0]
    return same


@compiled
def describe_segments(points: Array, radius: Array, density: Array, softness: Array, segments: Array) -> None:
    """Fill ``segments`` [K, SEGMENT_FIELDS]: u, e = v − u, 1/|e|², and start and step of radius, density, softness."""
    one, epsilon = points.dtype.type(1.0), points.dtype.type(LENGTH_EPSILON)
    n_points = points.shape[0]
    for k in range(segments.shape[0]):
        j = min(k + 1, n_points - 1)  # a path of one point is a disc
        field = segments[k]
        ex, ey = points[j, 0] - points[k, 0], points[j, 1] - points[k, 1]
        field[0], field[1], field[2], field[3] = points[k, 0], points[k, 1], ex, ey
        field[4] = one / max(ex * ex + ey * ey, epsilon)
        field[5], field[6] = radius[k], radius[j] - radius[k]
        field[7], field[8] = density[k], density[j] - density[k]
        field[9], field[10] = softness[k], softness[j] - softness[k]


@inlined
def _nearest(
    segment: Array, k: int, gy: float, first: int, columns: Array, rank: Array, radius: Array, winner: Array
) -> None:
    """Rank LANES columns by (D/R)² where there is ink, without root and power."""
    zero, one, floor = rank.dtype.type(0.0), rank.dtype.type(1.0), rank.dtype.type(R_MIN)
    half = rank.dtype.type(HALF_PX)
    ux, ex, ey, inverse, r_u, r_step = segment[0], segment[2], segment[3], segment[4], segment[5], segment[6]
    along = gy * ey
    for i in range(LANES):
        c = np.uintp(first + i)
        gx = columns[c] - ux
        t = min(max((gx * ex + along) * inverse, zero), one)
        wx, wy = gx - t * ex, gy - t * ey
        r = max(r_u + t * r_step, floor)
        d2, reach = wx * wx + wy * wy, r + half
        share = d2 / (r * r)
        better = (share < rank[c]) & (d2 < reach * reach)
        rank[c] = share if better else rank[c]
        radius[c] = r if better else radius[c]
        winner[c] = np.int32(k) if better else winner[c]


@inlined
def _darkest(segment: Array, k: int, gy: float, first: int, columns: Array, rank: Array, winner: Array) -> None:
    """Rank LANES columns by −coverage."""
    zero, one, floor = rank.dtype.type(0.0), rank.dtype.type(1.0), rank.dtype.type(R_MIN)
    half, rim = rank.dtype.type(HALF_PX), rank.dtype.type(RIM_PX)
    ux, ex, ey, inverse, r_u, r_step = segment[0], segment[2], segment[3], segment[4], segment[5], segment[6]
    rho, rho_step, soft, soft_step = segment[7], segment[8], segment[9], segment[10]
    along = gy * ey
    for i in range(LANES):
        c = np.uintp(first + i)
        gx = columns[c] - ux
        t = min(max((gx * ex + along) * inverse, zero), one)
        wx, wy = gx - t * ex, gy - t * ey
        d, r = np.sqrt(wx * wx + wy * wy), max(r_u + t * r_step, floor)
        q, edge = min(max(r - d, rim) / r, one), min(r, d + half) + min(r, half - d)
        value = (rho + t * rho_step) * exp2((soft + t * soft_step) * log2(q)) * edge
        lighter = -value if edge > zero else one
        better = lighter < rank[c]
        rank[c] = lighter if better else rank[c]
        winner[c] = np.int32(k) if better else winner[c]


@inlined
def _darken(density: float, softness: float, first: int, rank: Array, radius: Array) -> None:
    """Convert (D/R)² to −coverage for LANES columns, 1 where there is no ink."""
    zero, one = rank.dtype.type(0.0), rank.dtype.type(1.0)
    half, rim, floor = rank.dtype.type(HALF_PX), rank.dtype.type(RIM_PX), rank.dtype.type(R_MIN)
    for i in range(LANES):
        c = np.uintp(first + i)
        r = max(radius[c], floor)
        d = np.sqrt(rank[c]) * r
        q, edge = min(max(r - d, rim) / r, one), min(r, d + half) + min(r, half - d)
        rank[c] = -(density * exp2(softness * log2(q)) * edge) if edge > zero else one


@compiled
def cover(
    segments: Array,
    constant: bool,
    columns: Array,
    rank: Array,
    thickness: Array,
    winner: Array,
    left: Array,
    right: Array,
    top: int,
    width: int,
) -> tuple[int, int, int]:
    """Compute one stroke's coverage on a band of rows.

    Args:
        segments: [K, SEGMENT_FIELDS] as by ``describe_segments``.
        constant: density and softness are equal at all points of the stroke.
        columns: float[W + LANES], 0, 1, 2, …
        rank: float[rows, W + LANES], all FAR. On return −coverage where there is ink, 1 or FAR otherwise.
        thickness: float of the same shape; for the radius at each pixel.
        winner: int32 of the same shape. On return the segment with the largest coverage.
        left, right: int32[rows], filled with W and 0. On return the columns between which ink may lie.
        top: the canvas row of the band's first row.
        width: W.

    Returns:
        The band's rows r0:r1 that may hold ink, and the number of pixel-segment pairs that were evaluated.
    """
    rows = rank.shape[0]
    floor, infinite = rank.dtype.type(R_MIN), rank.dtype.type(FAR)
    low, high, evaluated = rows, 0, 0
    for k in range(segments.shape[0]):
        segment = segments[k]
        ux, uy, ex, ey = segment[0], segment[1] - rank.dtype.type(top), segment[2], segment[3]
        reach = max(segment[5], segment[5] + segment[6], floor) + rank.dtype.type(HALF_PX)
        r0 = _first(min(uy, uy + ey) - reach, rows)
        r1 = _end(max(uy, uy + ey) + reach, rows)
        c0 = _first(min(ux, ux + ex) - reach, width)
        c1 = _end(max(ux, ux + ex) + reach, width)
        if r0 >= r1 or c0 >= c1:
            continue
        low, high = min(low, r0), max(high, r1)
        # In each row, a long slanting segment reaches only the part of its box within a band of width 2·reach.
        slanting = c1 - c0 > LANES and abs(ey) > floor
        slope = ex / ey if slanting else floor
        half = reach * np.sqrt(ex * ex + ey * ey) / abs(ey) if slanting else infinite
        for r in range(r0, r1):
            gy = rank.dtype.type(r) - uy
            start, end = c0, c1
            if slanting:
                middle = ux + gy * slope
                start, end = max(c0, _first(middle - half, width)), min(c1, _end(middle + half, width))
            left[r], right[r] = min(left[r], start), max(right[r], end)
            evaluated += max(end - start, 0)
            row_rank, row_thickness, row_winner = rank[r], thickness[r], winner[r]
            for first in range(start, end, LANES):
                if constant:
                    _nearest(segment, k, gy, first, columns, row_rank, row_thickness, row_winner)
                else:
                    _darkest(segment, k, gy, first, columns, row_rank, row_winner)
    if constant:
        for r in range(low, high):
            for first in range(left[r], right[r], LANES):
                _darken(segments[0, 7], segments[0, 9], first, rank[r], thickness[r])
    return low, high, evaluated


@inlined
def _first(position: float, size: int) -> int:
    """The first pixel centre at or after a position, within 0 to ``size``."""
    return int(np.ceil(min(max(position, 0.0), size * 1.0)))


@inlined
def _end(position: float, size: int) -> int:
    """One past the last pixel centre at or before a position, within 0 to ``size``."""
    return int(np.floor(min(max(position, -1.0), size - 1.0))) + 1
