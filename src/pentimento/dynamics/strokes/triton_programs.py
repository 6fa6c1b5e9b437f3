"""The GPU programs of ``triton_kernel``: one program a tile, with a forward and a backward pass over its strokes.

A *visit* is one stroke in one tile, a *touch* one of its segments there (``tiles``). The formula is that of
``pentimento.render.kernel``; of each stroke only the segments that touch the tile are evaluated.
"""

# Triton gives the arguments of its programs their types when they are launched.
# mypy: disable-error-code="no-untyped-def,no-untyped-call"

from __future__ import annotations

import triton
import triton.language as tl

from pentimento.render.coverage import HALF_PX, LENGTH_EPSILON, R_MIN, RIM_PX

PATH = tl.constexpr(5)
"""Numbers a path point: column, row, radius, density, softness."""
SUMS = tl.constexpr(13)
"""Sums a touch: PATH for the segment's start, PATH for its end, 3 for the stroke's colour."""
_R_MIN = tl.constexpr(R_MIN)
_HALF_PX = tl.constexpr(HALF_PX)
_RIM_PX = tl.constexpr(RIM_PX)
_LENGTH_EPSILON = tl.constexpr(LENGTH_EPSILON)
_INTEGERS = ["n_points", "height", "width", "tiles_x", "tiles"]  # a new size must not compile the programs again


@triton.jit
def _pixels(height, width, tiles_x, tiles, SIDE: tl.constexpr):
    """Rows and columns of this program's pixels, where their red is in the image, and which are on the canvas."""
    painting = tl.program_id(0) // tiles
    spot = tl.program_id(0) % tiles
    inside = tl.arange(0, SIDE * SIDE)
    row = spot // tiles_x * SIDE + inside // SIDE
    column = spot % tiles_x * SIDE + inside % SIDE
    at = ((painting.to(tl.int64) * height + row) * width + column) * 3
    return row, column, at, (row < height) & (column < width)


@triton.jit
def _ends(path, stroke, k, n_points):
    """Where the numbers of segment k's two ends start."""
    start = path + stroke * n_points * PATH
    return start + k * PATH, start + tl.minimum(k + 1, n_points - 1) * PATH


@triton.jit
def _nearest(u, v, column, row):
    """From the segment's nearest point to each pixel; t there; t without its bounds, its slope; and the edge."""
    ux, uy = tl.load(u), tl.load(u + 1)
    ex, ey = tl.load(v) - ux, tl.load(v + 1) - uy
    gx, gy = column.to(ux.dtype) - ux, row.to(ux.dtype) - uy
    inverse = 1.0 / tl.maximum(ex * ex + ey * ey, _LENGTH_EPSILON)
    t_free = (gx * ex + gy * ey) * inverse
    t = tl.minimum(tl.maximum(t_free, 0.0), 1.0)
    return gx - t * ex, gy - t * ey, t, t_free, inverse, ex, ey


@triton.jit
def _along(u, v, field: tl.constexpr, t):
    """A number of the path at t, and its step over the segment."""
    start = tl.load(u + field)
    step = tl.load(v + field) - start
    return start + t * step, step


@triton.jit
def _darkness(distance, radius):
    """R, max(R − D, RIM_PX), q and the edge of the coverage ρ q^c · edge."""
    radius = tl.maximum(radius, _R_MIN)
    profile = tl.maximum(radius - distance, _RIM_PX)
    edge = tl.minimum(radius, distance + _HALF_PX) + tl.minimum(radius + distance, _HALF_PX) - distance
    return radius, profile, tl.minimum(profile / radius, 1.0), edge


@triton.jit(do_not_specialize=_INTEGERS)
def paint_tile(
    path, color, constant, canvas, image, tile_start, visit_stroke, visit_start, segment, winner, below,
    n_points, height, width, tiles_x, tiles, KEEP: tl.constexpr, SIDE: tl.constexpr,
):  # fmt: skip
    """Lay the strokes that visit one tile over it, in order.

    ``constant`` tells of each stroke whether density and softness are equal along it.
    """
    row, column, at, on = _pixels(height, width, tiles_x, tiles, SIDE)
    inside = tl.arange(0, SIDE * SIDE)
    red = tl.load(canvas + at, mask=on, other=0.0)
    green = tl.load(canvas + at + 1, mask=on, other=0.0)
    blue = tl.load(canvas + at + 2, mask=on, other=0.0)
    for visit in range(tl.load(tile_start + tl.program_id(0)), tl.load(tile_start + tl.program_id(0) + 1)):
        stroke = tl.load(visit_stroke + visit)
        by_distance = tl.load(constant + stroke) != 0
        coverage = tl.zeros_like(red)
        highest = tl.full([SIDE * SIDE], float("-inf"), red.dtype)
        best = tl.full([SIDE * SIDE], -1, tl.int32)
        for touch in range(tl.load(visit_start + visit), tl.load(visit_start + visit + 1)):
            k = tl.load(segment + touch)
            u, v = _ends(path, stroke, k, n_points)
            wx, wy, t, _t_free, _inverse, _ex, _ey = _nearest(u, v, column, row)
            radius, _step = _along(u, v, 2, t)
            density, _step = _along(u, v, 3, t)
            softness, _step = _along(u, v, 4, t)
            distance = tl.sqrt(wx * wx + wy * wy)
            radius, _profile, q, edge = _darkness(distance, radius)
            value = density * tl.exp(softness * tl.log(q)) * edge
            rank = tl.where(by_distance, -distance / radius, value)
            better = (edge > 0.0) & (rank > highest)
            highest = tl.where(better, rank, highest)
            coverage = tl.where(better, value, coverage)
            best = tl.where(better, k, best)
        if KEEP:
            tl.store(winner + visit * SIDE * SIDE + inside, best)
            place = below + visit * 3 * SIDE * SIDE + inside
            tl.store(place, red)
            tl.store(place + SIDE * SIDE, green)
            tl.store(place + 2 * SIDE * SIDE, blue)
        red += coverage * (tl.load(color + stroke * 3) - red)
        green += coverage * (tl.load(color + stroke * 3 + 1) - green)
        blue += coverage * (tl.load(color + stroke * 3 + 2) - blue)
    tl.store(image + at, red, mask=on)
    tl.store(image + at + 1, green, mask=on)
    tl.store(image + at + 2, blue, mask=on)


@triton.jit
def _pull(u, v, column, row, won, g_coverage, sums):
    """Store one segment's gradient sums for its two ends; return its coverage where it ``won``, else 0.

    Unless t is at a bound, the distance D is stationary in t, so its gradient reaches the ends only through their
    interpolation weights. Radius, density and softness change along the segment, so their gradients also reach the
    ends through t (``g_t``).
    """
    wx, wy, t, t_free, inverse, ex, ey = _nearest(u, v, column, row)
    distance = tl.sqrt(wx * wx + wy * wy)
    radius, radius_step = _along(u, v, 2, t)
    density, density_step = _along(u, v, 3, t)
    softness, softness_step = _along(u, v, 4, t)
    radius_free = radius
    radius, profile, q, edge = _darkness(distance, radius)
    log_q = tl.log(q)
    power = tl.exp(softness * log_q)
    g_dark = tl.where(won, g_coverage, 0.0) * power
    g_density = g_dark * edge
    g_edge = g_dark * density
    g_softness = g_density * density * log_q
    g_profile = tl.where(q < 1.0, g_density * density * softness / profile, 0.0)
    sloped = tl.where(radius - distance > _RIM_PX, 1.0, 0.0)
    outer = tl.where(radius <= distance + _HALF_PX, 1.0, 0.0)
    inner = tl.where(radius + distance <= _HALF_PX, 1.0, 0.0)
    g_radius = g_profile * (sloped - q) + g_edge * (inner + outer)
    g_radius = tl.where(radius_free > _R_MIN, g_radius, 0.0)
    g_distance = g_edge * (inner - outer) - g_profile * sloped
    pull = tl.where(distance > 0.0, -g_distance / tl.where(distance > 0.0, distance, 1.0), 0.0)
    slope = tl.where(ex * ex + ey * ey > _LENGTH_EPSILON, inverse, 0.0)
    g_t = (g_radius * radius_step + g_density * density_step + g_softness * softness_step) * slope
    g_t = tl.where((t_free > 0.0) & (t_free < 1.0), g_t, 0.0)
    vx, vy = wx - t * ex, wy - t * ey
    tl.store(sums, tl.sum((1.0 - t) * pull * wx - g_t * (ex + vx)))
    tl.store(sums + 1, tl.sum((1.0 - t) * pull * wy - g_t * (ey + vy)))
    tl.store(sums + 2, tl.sum((1.0 - t) * g_radius))
    tl.store(sums + 3, tl.sum((1.0 - t) * g_density))
    tl.store(sums + 4, tl.sum((1.0 - t) * g_softness))
    tl.store(sums + 5, tl.sum(t * pull * wx + g_t * vx))
    tl.store(sums + 6, tl.sum(t * pull * wy + g_t * vy))
    tl.store(sums + 7, tl.sum(t * g_radius))
    tl.store(sums + 8, tl.sum(t * g_density))
    tl.store(sums + 9, tl.sum(t * g_softness))
    return tl.where(won, density * power * edge, 0.0)


@triton.jit(do_not_specialize=_INTEGERS)
def unpaint_tile(
    path, color, g_image, g_canvas, tile_start, visit_stroke, visit_start, segment, slot, winner, below, sums,
    n_points, height, width, tiles_x, tiles, SIDE: tl.constexpr,
):  # fmt: skip
    """Undo the strokes that visit one tile, last first, and store the gradient sums of each segment."""
    row, column, at, on = _pixels(height, width, tiles_x, tiles, SIDE)
    inside = tl.arange(0, SIDE * SIDE)
    g_red = tl.load(g_image + at, mask=on, other=0.0)
    g_green = tl.load(g_image + at + 1, mask=on, other=0.0)
    g_blue = tl.load(g_image + at + 2, mask=on, other=0.0)
    first = tl.load(tile_start + tl.program_id(0))
    last = tl.load(tile_start + tl.program_id(0) + 1) - 1
    for back in range(0, last - first + 1):
        visit = last - back
        stroke = tl.load(visit_stroke + visit)
        best = tl.load(winner + visit * SIDE * SIDE + inside).to(tl.int32)
        place = below + visit * 3 * SIDE * SIDE + inside
        g_coverage = g_red * (tl.load(color + stroke * 3) - tl.load(place))
        g_coverage += g_green * (tl.load(color + stroke * 3 + 1) - tl.load(place + SIDE * SIDE))
        g_coverage += g_blue * (tl.load(color + stroke * 3 + 2) - tl.load(place + 2 * SIDE * SIDE))
        coverage = tl.zeros_like(g_red)
        start = tl.load(visit_start + visit)
        for touch in range(start, tl.load(visit_start + visit + 1)):
            k = tl.load(segment + touch)
            u, v = _ends(path, stroke, k, n_points)
            coverage += _pull(u, v, column, row, best == k, g_coverage, sums + tl.load(slot + touch) * SUMS)
        paint = (
            sums + tl.load(slot + start) * SUMS + 2 * PATH
        )  # the gradient of the stroke's colour is stored with its first touch
        tl.store(paint, tl.sum(g_red * coverage))
        tl.store(paint + 1, tl.sum(g_green * coverage))
        tl.store(paint + 2, tl.sum(g_blue * coverage))
        g_red *= 1.0 - coverage
        g_green *= 1.0 - coverage
        g_blue *= 1.0 - coverage
    tl.store(g_canvas + at, g_red, mask=on)
    tl.store(g_canvas + at + 1, g_green, mask=on)
    tl.store(g_canvas + at + 2, g_blue, mask=on)
