"""Strokes onto canvases, compiled with Numba: exact values and exact gradients, work only where ink falls.

The coverage of a stroke at a pixel G is the largest over its segments u → v of (thesis 5.1-5.5, corrected)

    T = clamp((G − u)·(v − u) / max(|v − u|², ε), 0, 1)      where on the segment
    D = |G − u − T (v − u)|                                  distance to the segment
    R = max((1 − T) r_u + T r_v, R_MIN)                      radius there; density ρ and softness c likewise
    coverage = ρ · max(1 − D/R, Q_MIN)^c  if D < R else 0

and strokes are laid over the canvas in their order, in linear light: image ← image + coverage · (colour − image).

The thesis prints two slips that the formula above repairs: its (5.1) takes the least of the distances to the *line*
and to both ends, which is the distance to an infinite line; its (5.2) drops the sign of the projection.

What a stroke leaves at a pixel is kept as a *fragment* (place, coverage, winning segment, colour below), so memory
grows with inked area, never with strokes × canvas, and the backward pass visits just the pixels that have ink.

Pixel coordinates are (column, row); the centre of pixel (r, c) is (c, r). See ``pentimento.contracts.frames``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pentimento.contracts.errors import PentimentoError

R_MIN = 0.05
"""Floor under the radius [px]: thinner strokes fall between pixel centres and lose their gradient."""
Q_MIN = 1e-3
"""Floor under 1 − D/R where there is ink: keeps the slope of (1 − D/R)^c finite at the rim for c < 1."""
_LENGTH_EPSILON = 1e-12

Array = NDArray[Any]


class RenderInputError(PentimentoError):
    """An input of the renderer has a wrong shape or a value that is not finite."""


class Fragments(NamedTuple):
    """Where ink fell, in the order in which it was laid; one set for each painting of the batch.

    ``start`` int64[B, S+1]: fragments of stroke s of painting b are ``start[b, s]:start[b, s+1]`` of the row b lists.
    """

    start: Array
    pixel: tuple[Array, ...]
    segment: tuple[Array, ...]
    coverage: tuple[Array, ...]
    below: tuple[Array, ...]


class StrokeGradients(NamedTuple):
    """∂loss/∂input, each of its input's shape."""

    points: Array
    radius: Array
    density: Array
    softness: Array
    color: Array
    canvas: Array


_jit = njit(cache=True, fastmath=True, error_model="numpy", boundscheck=False)


@_jit
def _segment_box(
    ux: float, uy: float, ex: float, ey: float, reach: float, height: int, width: int
) -> tuple[int, int, int, int]:
    """Rows r0:r1 and columns c0:c1 of the pixels that a segment can reach; empty where it is off the canvas."""
    c0 = max(int(np.ceil(max(min(ux, ux + ex) - reach, -1.0))), 0)
    c1 = min(int(np.floor(min(max(ux, ux + ex) + reach, width * 1.0))) + 1, width)
    r0 = max(int(np.ceil(max(min(uy, uy + ey) - reach, -1.0))), 0)
    r1 = min(int(np.floor(min(max(uy, uy + ey) + reach, height * 1.0))) + 1, height)
    return r0, r1, c0, c1


@_jit
def _nearest_segments(
    points: Array, radius: Array, nearness: Array, winner: Array, box: tuple[int, int, int, int]
) -> None:
    """Where density and softness are constant, the segment of the least (D/R)² wins; it goes to ``nearness``.

    The loop over columns has no branch, no root and no power, so that the compiler makes it a vector loop.
    """
    one, zero = points.dtype.type(1.0), points.dtype.type(0.0)
    floor, epsilon = points.dtype.type(R_MIN), points.dtype.type(_LENGTH_EPSILON)
    n_points = points.shape[0]
    box_r0, box_r1, box_c0, box_c1 = box
    for k in range(max(n_points - 1, 1)):
        j = min(k + 1, n_points - 1)  # a path of one point is a disc
        ux, uy = points[k, 0], points[k, 1]
        ex, ey = points[j, 0] - ux, points[j, 1] - uy
        r_u, r_step = radius[k], radius[j] - radius[k]
        r0, r1, c0, c1 = _segment_box(ux, uy, ex, ey, max(r_u, radius[j], floor), box_r1, box_c1)
        inverse = one / max(ex * ex + ey * ey, epsilon)
        for r in range(max(r0, box_r0), r1):
            gy = points.dtype.type(r) - uy
            along_row = gy * ey
            near, win = nearness[r], winner[r]
            for c in range(max(c0, box_c0), c1):
                gx = points.dtype.type(c) - ux
                t = min(max((gx * ex + along_row) * inverse, zero), one)
                wx, wy = gx - t * ex, gy - t * ey
                rad = max(r_u + t * r_step, floor)
                share2 = (wx * wx + wy * wy) / (rad * rad)
                closer = share2 < near[c]
                near[c] = share2 if closer else near[c]
                win[c] = k if closer else win[c]


@_jit
def _darkest_segments(
    points: Array,
    radius: Array,
    density: Array,
    softness: Array,
    coverage: Array,
    winner: Array,
    box: tuple[int, int, int, int],
) -> None:
    """Where density or softness varies along the path, the segment of the largest coverage wins."""
    one, zero = points.dtype.type(1.0), points.dtype.type(0.0)
    floor, epsilon, q_floor = points.dtype.type(R_MIN), points.dtype.type(_LENGTH_EPSILON), points.dtype.type(Q_MIN)
    n_points = points.shape[0]
    box_r0, box_r1, box_c0, box_c1 = box
    for k in range(max(n_points - 1, 1)):
        j = min(k + 1, n_points - 1)
        ux, uy = points[k, 0], points[k, 1]
        ex, ey = points[j, 0] - ux, points[j, 1] - uy
        r_u, r_step = radius[k], radius[j] - radius[k]
        r0, r1, c0, c1 = _segment_box(ux, uy, ex, ey, max(r_u, radius[j], floor), box_r1, box_c1)
        inverse = one / max(ex * ex + ey * ey, epsilon)
        for r in range(max(r0, box_r0), r1):
            gy = points.dtype.type(r) - uy
            for c in range(max(c0, box_c0), c1):
                gx = points.dtype.type(c) - ux
                t = min(max((gx * ex + gy * ey) * inverse, zero), one)
                wx, wy = gx - t * ex, gy - t * ey
                rad = max(r_u + t * r_step, floor)
                d2 = wx * wx + wy * wy
                if d2 < rad * rad:
                    q = max(one - np.sqrt(d2) / rad, q_floor)
                    rho = density[k] + t * (density[j] - density[k])
                    value = rho * q ** (softness[k] + t * (softness[j] - softness[k]))
                    if value > coverage[r, c]:
                        coverage[r, c] = value
                        winner[r, c] = k


@_jit
def _render_painting(
    points: Array, radius: Array, density: Array, softness: Array, color: Array, image: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """Lay every stroke on ``image`` in place; return the fragments."""
    one = points.dtype.type(1.0)
    q_floor = points.dtype.type(Q_MIN)
    n_strokes, n_points, _ = points.shape
    height, width = image.shape[0], image.shape[1]
    nearness = np.full((height, width), 1, points.dtype)
    coverage = np.zeros((height, width), points.dtype)
    winner = np.zeros((height, width), np.int32)
    start = np.zeros(n_strokes + 1, np.int64)
    room = 16384
    pixel = np.empty(room, np.int32)
    segment = np.empty(room, np.int32)
    alpha = np.empty(room, points.dtype)
    below = np.empty((room, 3), points.dtype)
    count = 0
    for s in range(n_strokes):
        constant = True
        reach = points.dtype.type(R_MIN)
        left, right, top, bottom = points[s, 0, 0], points[s, 0, 0], points[s, 0, 1], points[s, 0, 1]
        for i in range(n_points):
            constant &= density[s, i] == density[s, 0] and softness[s, i] == softness[s, 0]
            reach = max(reach, radius[s, i])
            left, right = min(left, points[s, i, 0]), max(right, points[s, i, 0])
            top, bottom = min(top, points[s, i, 1]), max(bottom, points[s, i, 1])
        box = _segment_box(left, top, right - left, bottom - top, reach, height, width)
        r0, r1, c0, c1 = box
        if r0 >= r1 or c0 >= c1:
            start[s + 1] = count
            continue
        if constant:
            _nearest_segments(points[s], radius[s], nearness, winner, box)
        else:
            _darkest_segments(points[s], radius[s], density[s], softness[s], coverage, winner, box)
        needed = count + (r1 - r0) * (c1 - c0)
        if needed > room:
            room = max(needed, 2 * room)
            grown_pixel = np.empty(room, np.int32)
            grown_segment = np.empty(room, np.int32)
            grown_alpha = np.empty(room, points.dtype)
            grown_below = np.empty((room, 3), points.dtype)
            grown_pixel[:count] = pixel[:count]
            grown_segment[:count] = segment[:count]
            grown_alpha[:count] = alpha[:count]
            grown_below[:count] = below[:count]
            pixel, segment, alpha, below = grown_pixel, grown_segment, grown_alpha, grown_below
        rho, soft = density[s, 0], softness[s, 0]
        red, green, blue = color[s, 0], color[s, 1], color[s, 2]
        for r in range(r0, r1):
            near, dark, win, under = nearness[r], coverage[r], winner[r], image[r]
            for c in range(c0, c1):
                if constant:
                    if near[c] >= one:
                        continue
                    a = rho * max(one - np.sqrt(near[c]), q_floor) ** soft
                    near[c] = one
                else:
                    a = dark[c]
                    dark[c] = 0
                if a > 0:
                    under_red, under_green, under_blue = under[c, 0], under[c, 1], under[c, 2]
                    pixel[count], segment[count], alpha[count] = r * width + c, win[c], a
                    below[count, 0], below[count, 1], below[count, 2] = under_red, under_green, under_blue
                    under[c, 0] = under_red + a * (red - under_red)
                    under[c, 1] = under_green + a * (green - under_green)
                    under[c, 2] = under_blue + a * (blue - under_blue)
                    count += 1
        start[s + 1] = count
    return start, pixel[:count], segment[:count], alpha[:count], below[:count]


@_jit
def _backward_painting(
    points: Array,
    radius: Array,
    density: Array,
    softness: Array,
    color: Array,
    width: int,
    start: Array,
    pixel: Array,
    segment: Array,
    alpha: Array,
    below: Array,
    g_image: Array,
    g_points: Array,
    g_radius: Array,
    g_density: Array,
    g_softness: Array,
    g_color: Array,
) -> None:
    """Accumulate the gradients of one painting; ``g_image`` [H·W, C] ends as the gradient of the canvas."""
    n_strokes, n_points, _ = points.shape
    one, zero = points.dtype.type(1.0), points.dtype.type(0.0)
    floor, epsilon, q_floor = points.dtype.type(R_MIN), points.dtype.type(_LENGTH_EPSILON), points.dtype.type(Q_MIN)
    for s in range(n_strokes - 1, -1, -1):
        path, widths, densities, softnesses = points[s], radius[s], density[s], softness[s]
        g_path, g_widths, g_densities, g_softnesses = g_points[s], g_radius[s], g_density[s], g_softness[s]
        red, green, blue = color[s, 0], color[s, 1], color[s, 2]
        g_red, g_green, g_blue = zero, zero, zero
        for f in range(start[s], start[s + 1]):
            p = pixel[f]
            a = alpha[f]
            g_pixel, under, left = g_image[p], below[f], one - a
            g0, g1, g2 = g_pixel[0], g_pixel[1], g_pixel[2]
            g_alpha = g0 * (red - under[0]) + g1 * (green - under[1]) + g2 * (blue - under[2])
            g_red += g0 * a
            g_green += g1 * a
            g_blue += g2 * a
            g_pixel[0], g_pixel[1], g_pixel[2] = g0 * left, g1 * left, g2 * left
            if g_alpha == zero:
                continue
            k = segment[f]
            j = min(k + 1, n_points - 1)
            row = p // width
            ux, uy = path[k, 0], path[k, 1]
            ex, ey = path[j, 0] - ux, path[j, 1] - uy
            r_step = widths[j] - widths[k]
            rho_step = densities[j] - densities[k]
            soft_step = softnesses[j] - softnesses[k]
            gx, gy = points.dtype.type(p - row * width) - ux, points.dtype.type(row) - uy
            length2 = ex * ex + ey * ey
            inverse = one / max(length2, epsilon)
            t_free = (gx * ex + gy * ey) * inverse
            t = min(max(t_free, zero), one)
            wx, wy = gx - t * ex, gy - t * ey
            d = np.sqrt(wx * wx + wy * wy)
            rad_free = widths[k] + t * r_step
            per_rad = one / max(rad_free, floor)
            q_free = one - d * per_rad
            q = max(q_free, q_floor)
            rho = densities[k] + t * rho_step
            soft = softnesses[k] + t * soft_step
            power = a / rho if rho != zero else q**soft
            g_rho = g_alpha * power
            g_soft = g_alpha * a * np.log(q)
            g_q = g_alpha * soft * a / q if q_free > q_floor else zero
            g_rad = g_q * d * per_rad * per_rad if rad_free > floor else zero
            g_densities[k] += (one - t) * g_rho
            g_densities[j] += t * g_rho
            g_softnesses[k] += (one - t) * g_soft
            g_softnesses[j] += t * g_soft
            g_widths[k] += (one - t) * g_rad
            g_widths[j] += t * g_rad
            # D is stationary in T wherever T is free, so the distance pulls on the ends by their share alone.
            if d > zero:
                pull = g_q * per_rad / d
                g_path[k, 0] += (one - t) * pull * wx
                g_path[k, 1] += (one - t) * pull * wy
                g_path[j, 0] += t * pull * wx
                g_path[j, 1] += t * pull * wy
            g_t = (g_rad * r_step + g_rho * rho_step + g_soft * soft_step) * inverse
            if g_t != zero and zero < t_free < one and length2 > epsilon:
                vx, vy = gx - (t + t) * ex, gy - (t + t) * ey
                g_path[j, 0] += g_t * vx
                g_path[j, 1] += g_t * vy
                g_path[k, 0] -= g_t * (ex + vx)
                g_path[k, 1] -= g_t * (ey + vy)
        g_color[s, 0] += g_red
        g_color[s, 1] += g_green
        g_color[s, 2] += g_blue


def render(
    points: Array, radius: Array, density: Array, softness: Array, color: Array, canvas: Array
) -> tuple[Array, Fragments]:
    """Lay strokes on canvases, in order.

    Args:
        points: float[B, S, N, 2], path points in pixel coordinates (column, row).
        radius: float[B, S, N], half the stroke's width [px].
        density: float[B, S, N], coverage at the centre of the path, 0 to 1.
        softness: float[B, S, N], the exponent c: 0 gives a hard disc, 1 a cone.
        color: float[B, S, 3], linear light.
        canvas: float[B, H, W, 3], linear light; left as it is.

    Returns:
        The images, float[B, H, W, 3], and the fragments that ``render_backward`` needs.

    Raises:
        RenderInputError: a shape does not fit or a value is not finite; the sentence names the first offender.
    """
    _check_inputs(points, radius, density, softness, color, canvas)
    image = np.array(canvas, copy=True, order="C")
    paintings = [
        _render_painting(points[b], radius[b], density[b], softness[b], color[b], image[b])
        for b in range(points.shape[0])
    ]
    starts, pixel, segment, coverage, below = zip(*paintings, strict=True)
    return image, Fragments(np.stack(starts), pixel, segment, coverage, below)


def render_backward(
    points: Array,
    radius: Array,
    density: Array,
    softness: Array,
    color: Array,
    fragments: Fragments,
    image_gradient: Array,
) -> StrokeGradients:
    """Gradients of a loss with respect to all inputs of ``render``, from ∂loss/∂image float[B, H, W, 3]."""
    batch, height, width, channels = image_gradient.shape
    g_canvas = np.array(image_gradient, copy=True, order="C")
    gradients = StrokeGradients(
        np.zeros_like(points), np.zeros_like(radius), np.zeros_like(density), np.zeros_like(softness),
        np.zeros_like(color), g_canvas,
    )  # fmt: skip
    for b in range(batch):
        _backward_painting(
            points[b], radius[b], density[b], softness[b], color[b], width,
            fragments.start[b], fragments.pixel[b], fragments.segment[b],
            fragments.coverage[b], fragments.below[b],
            g_canvas[b].reshape(height * width, channels), gradients.points[b], gradients.radius[b],
            gradients.density[b], gradients.softness[b], gradients.color[b],
        )  # fmt: skip
    return gradients


def _check_inputs(points: Array, radius: Array, density: Array, softness: Array, color: Array, canvas: Array) -> None:
    if points.ndim != 4 or points.shape[-1] != 2 or points.shape[2] == 0 or canvas.ndim != 4 or canvas.size == 0:
        raise RenderInputError(
            f"The renderer needs points [B, S, N, 2] and a canvas [B, H, W, 3]; got {points.shape} and {canvas.shape}."
        )
    batch, strokes, n, _ = points.shape
    wanted = {
        "radius": (radius, (batch, strokes, n)),
        "density": (density, (batch, strokes, n)),
        "softness": (softness, (batch, strokes, n)),
        "color": (color, (batch, strokes, 3)),
        "canvas": (canvas, (batch, *canvas.shape[1:3], 3)),
        "points": (points, points.shape),
    }
    for name, (array, shape) in wanted.items():
        if array.shape != shape:
            raise RenderInputError(f"The renderer's {name} must have shape {shape}, not {array.shape}.")
        if array.dtype != points.dtype:
            raise RenderInputError(f"The renderer's {name} is {array.dtype}, but points are {points.dtype}.")
        if not np.isfinite(array).all():
            index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
            raise RenderInputError(f"The renderer's {name}{list(index)} is {array[index]}: every value must be finite.")
