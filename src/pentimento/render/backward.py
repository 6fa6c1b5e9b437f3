"""Backward pass: from the gradient of a band of the image to the gradients of its strokes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.render.composition import compose_backward, compose_carrying_backward
from pentimento.render.coverage import (
    HALF_PX,
    LANES,
    LENGTH_EPSILON,
    R_MIN,
    RIM_PX,
    SEGMENT_FIELDS,
    compiled,
    describe_segments,
    inlined,
)
from pentimento.render.fastmath import exp2, log2

Array = NDArray[Any]
POINT_FIELDS = 5
"""Fields of a path's point: x, y, radius, density, softness."""
_LN2 = float(np.log(2))
_READ = SEGMENT_FIELDS + 2
"""Fields that ``_gather`` reads for each fragment: G − u, the segment's other fields, coverage, its gradient."""
_PULLS = 10
"""Fields that ``_pull`` computes for each fragment: the gradient (x, y) of u and v together and of v alone; for radius,
density and softness the gradient at the fragment and T times it."""
SCRATCH = (_READ + _PULLS) * LANES
"""Size of the scratch array. It is one flat array at constant offsets, so that the compiler can rule out overlaps."""


@compiled
def backward_band(
    points: Array,
    radius: Array,
    density: Array,
    softness: Array,
    color: Array,
    pickup: Array,
    top: int,
    start: Array,
    column: Array,
    row: Array,
    segment: Array,
    coverage: Array,
    below: Array,
    g_image: Array,
    g_color: Array,
    g_pickup: Array,
) -> tuple[Array, Array]:
    """Gradients of ``lay_band``; ``g_image`` [rows, W, C] becomes that of the canvas.

    ``g_color`` [S, 3] and ``g_pickup`` [S] are added to. Returns the strokes with fragments, int64[T], and the
    gradients of their points, float[T, N, POINT_FIELDS].
    """
    n_points = points.shape[1]
    n_segments = max(n_points - 1, 1)
    segments = np.empty((n_segments, SEGMENT_FIELDS), points.dtype)
    sums = np.empty((n_segments, _PULLS), points.dtype)
    carried, g_carried = np.empty((n_segments, 4), points.dtype), np.empty((n_segments, 4), points.dtype)
    scratch = np.zeros(SCRATCH, points.dtype)
    touched = np.flatnonzero(start[1:] - start[:-1])
    g_points = np.zeros((touched.size, n_points, POINT_FIELDS), points.dtype)
    largest = 0
    for s in touched:
        largest = max(largest, start[s + 1] - start[s])
    g_coverage = np.zeros(largest + LANES, points.dtype)
    for at in range(touched.size - 1, -1, -1):
        s = touched[at]
        first, end = start[s], start[s + 1]
        if g_image.shape[2] == 4:
            g_pickup[s] += compose_carrying_backward(
                color[s], pickup[s], column, row, segment, coverage, below, first, end, g_image, g_coverage,
                g_color[s], carried, g_carried,
            )  # fmt: skip
        else:
            compose_backward(color[s], column, row, coverage, below, first, end, g_image, g_coverage, g_color[s])
        describe_segments(points[s], radius[s], density[s], softness[s], segments)
        sums[:] = 0
        for block in range(first, end, LANES):
            if block + LANES <= end and _of_one_segment(segment, block):
                fields, of_segment = segments[np.uintp(segment[block])], sums[np.uintp(segment[block])]
                _repeat(fields, top, column, row, coverage, g_coverage, block, block - first, scratch)
                _pull(scratch)
                _add_all(scratch, of_segment)
                continue
            _gather(segments, top, column, row, segment, coverage, g_coverage, block, block - first, scratch)
            _pull(scratch)
            _add(segment, block, min(block + LANES, end), scratch, sums)
        _spread(sums, g_points[at])
    return touched, g_points


@inlined
def _gather(
    segments: Array,
    top: int,
    column: Array,
    row: Array,
    segment: Array,
    coverage: Array,
    g_coverage: Array,
    first: int,
    at: int,
    scratch: Array,
) -> None:
    for i in range(LANES):
        f = np.uintp(first + i)
        fields = segments[np.uintp(segment[f])]
        scratch[i] = scratch.dtype.type(column[f]) - fields[0]
        scratch[LANES + i] = scratch.dtype.type(row[f] + top) - fields[1]
        for m in range(2, SEGMENT_FIELDS):
            scratch[m * LANES + i] = fields[m]
        scratch[SEGMENT_FIELDS * LANES + i] = coverage[f]
        scratch[(SEGMENT_FIELDS + 1) * LANES + i] = g_coverage[np.uintp(at + i)]


@inlined
def _of_one_segment(segment: Array, first: int) -> bool:
    """Whether LANES fragments belong to one segment, the common case where paths have few points. It is vectorised."""
    same = True
    for i in range(1, LANES):
        same &= segment[np.uintp(first + i)] == segment[np.uintp(first)]
    return same


@inlined
def _repeat(
    fields: Array,
    top: int,
    column: Array,
    row: Array,
    coverage: Array,
    g_coverage: Array,
    first: int,
    at: int,
    scratch: Array,
) -> None:
    """``_gather`` for fragments of one segment."""
    x, y = fields[0], fields[1] - scratch.dtype.type(top)
    for i in range(LANES):
        f = np.uintp(first + i)
        scratch[i] = scratch.dtype.type(column[f]) - x
        scratch[LANES + i] = scratch.dtype.type(row[f]) - y
        scratch[SEGMENT_FIELDS * LANES + i] = coverage[f]
        scratch[(SEGMENT_FIELDS + 1) * LANES + i] = g_coverage[np.uintp(at + i)]
    for m in range(2, SEGMENT_FIELDS):
        field = fields[m]
        for i in range(LANES):
            scratch[m * LANES + i] = field


@inlined
def _add_all(scratch: Array, of_segment: Array) -> None:
    """``_add`` for LANES fragments of one segment."""
    for m in range(_PULLS):
        total = scratch.dtype.type(0.0)
        for i in range(LANES):
            total += scratch[np.uintp((_READ + m) * LANES + i)]
        of_segment[m] += total


@inlined
def _pull(scratch: Array) -> None:
    """Chain rule through one coverage, for LANES fragments."""
    zero, one = scratch.dtype.type(0.0), scratch.dtype.type(1.0)
    floor, rim, half = scratch.dtype.type(R_MIN), scratch.dtype.type(RIM_PX), scratch.dtype.type(HALF_PX)
    shortest, ln2 = one / scratch.dtype.type(LENGTH_EPSILON), scratch.dtype.type(_LN2)
    for i in range(LANES):
        gx, gy, ex, ey = scratch[i], scratch[LANES + i], scratch[2 * LANES + i], scratch[3 * LANES + i]
        inverse, r_u, r_step = scratch[4 * LANES + i], scratch[5 * LANES + i], scratch[6 * LANES + i]
        rho_u, rho_step = scratch[7 * LANES + i], scratch[8 * LANES + i]
        c_u, c_step = scratch[9 * LANES + i], scratch[10 * LANES + i]
        a, g_a = scratch[11 * LANES + i], scratch[12 * LANES + i]
        t_free = (gx * ex + gy * ey) * inverse
        t = min(max(t_free, zero), one)
        wx, wy = gx - t * ex, gy - t * ey
        d = np.sqrt(wx * wx + wy * wy)
        r_free = r_u + t * r_step
        r = max(r_free, floor)
        within = r - d
        profile = max(within, rim)
        q = min(profile / r, one)
        edge = min(r, d + half) + min(r, half - d)
        log_q, soft = log2(q), c_u + t * c_step
        g_dark = g_a * exp2(soft * log_q)
        g_rho, g_edge = g_dark * edge, g_dark * (rho_u + t * rho_step)
        g_soft = g_a * a * log_q * ln2
        g_profile = g_a * soft * a / profile if q < one else zero
        # Which terms follow R and D: the profile, the outer minimum, the inner one.
        sloped = one if within > rim else zero
        outer, inner = one if r <= d + half else zero, one if r <= half - d else zero
        g_r = g_profile * (sloped - q) + g_edge * (inner + outer)
        g_r = g_r if r_free > floor else zero
        g_d = g_edge * (inner - outer) - g_profile * sloped
        # D is stationary in T where T is not clamped, so the distance acts on the ends by their share alone.
        pull = -g_d / d if d > zero else zero
        # Radius, density and softness depend on T, and T on both ends.
        g_t = (g_r * r_step + g_rho * rho_step + g_soft * c_step) * inverse
        g_t = g_t if (t_free > zero) & (t_free < one) & (inverse < shortest) else zero
        scratch[13 * LANES + i] = pull * wx - g_t * ex
        scratch[14 * LANES + i] = pull * wy - g_t * ey
        scratch[15 * LANES + i] = t * pull * wx + g_t * (gx - (t + t) * ex)
        scratch[16 * LANES + i] = t * pull * wy + g_t * (gy - (t + t) * ey)
        scratch[17 * LANES + i] = g_r
        scratch[18 * LANES + i] = t * g_r
        scratch[19 * LANES + i] = g_rho
        scratch[20 * LANES + i] = t * g_rho
        scratch[21 * LANES + i] = g_soft
        scratch[22 * LANES + i] = t * g_soft


@inlined
def _add(segment: Array, first: int, end: int, scratch: Array, sums: Array) -> None:
    """Add the fragments first:end of one block to their segments' ``sums`` [K, _PULLS]."""
    for f in range(first, end):
        of_segment = sums[np.uintp(segment[np.uintp(f)])]
        for m in range(_PULLS):
            of_segment[m] += scratch[np.uintp((_READ + m) * LANES + f - first)]


@compiled
def _spread(sums: Array, g_points: Array) -> None:
    """Distribute segments' sums to the gradients of the points [N, POINT_FIELDS] at their two ends."""
    for k in range(sums.shape[0]):
        j = min(k + 1, g_points.shape[0] - 1)
        for m in range(2):
            g_points[j, m] += sums[k, 2 + m]
            g_points[k, m] += sums[k, m] - sums[k, 2 + m]
        for m in range(2, POINT_FIELDS):
            g_points[j, m] += sums[k, 2 * m + 1]
            g_points[k, m] += sums[k, 2 * m] - sums[k, 2 * m + 1]
