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


@njit(cache=True, fastmath=True, error_model="numpy", boundscheck=False)
def _rasterize_stroke(
    points: Array,
    radius: Array,
    density: Array,
    softness: Array,
    coverage: Array,
    winner: Array,
    height: int,
    width: int,
) -> tuple[int, int, int, int]:
    """Write the stroke's coverage and winning segment into the scratch images; return its box (r0, r1, c0, c1)."""
    n_points = points.shape[0]
    constant_profile = True
    for i in range(1, n_points):
        if density[i] != density[0] or softness[i] != softness[0]:
            constant_profile = False
    box_r0, box_r1, box_c0, box_c1 = height, 0, width, 0
    for k in range(max(n_points - 1, 1)):
        j = min(k + 1, n_points - 1)  # a path of one point is a disc
        ux, uy = points[k, 0], points[k, 1]
        ex, ey = points[j, 0] - ux, points[j, 1] - uy
        r_u, r_v = radius[k], radius[j]
        reach = max(r_u, r_v, R_MIN)
        c0 = max(int(np.ceil(max(min(ux, ux + ex) - reach, -1.0))), 0)
        c1 = min(int(np.floor(min(max(ux, ux + ex) + reach, width * 1.0))) + 1, width)
        r0 = max(int(np.ceil(max(min(uy, uy + ey) - reach, -1.0))), 0)
        r1 = min(int(np.floor(min(max(uy, uy + ey) + reach, height * 1.0))) + 1, height)
        if c0 >= c1 or r0 >= r1:
            continue
        box_r0, box_r1 = min(box_r0, r0), max(box_r1, r1)
        box_c0, box_c1 = min(box_c0, c0), max(box_c1, c1)
        inverse = points.dtype.type(1.0) / max(ex * ex + ey * ey, points.dtype.type(_LENGTH_EPSILON))
        for r in range(r0, r1):
            gy = r - uy
            for c in range(c0, c1):
                gx = c - ux
                t = (gx * ex + gy * ey) * inverse
                t = min(max(t, points.dtype.type(0.0)), points.dtype.type(1.0))
                wx, wy = gx - t * ex, gy - t * ey
                rad = max(r_u + t * (r_v - r_u), points.dtype.type(R_MIN))
                d2 = wx * wx + wy * wy
                if d2 >= rad * rad:
                    continue
                q = max(points.dtype.type(1.0) - np.sqrt(d2) / rad, points.dtype.type(Q_MIN))
                if constant_profile:
                    # Coverage grows with q, so the power is taken once a pixel, after the winner is known.
                    value = q
                else:
                    rho = density[k] + t * (density[j] - density[k])
                    value = rho * q ** (softness[k] + t * (softness[j] - softness[k]))
                if value > coverage[r, c]:
                    coverage[r, c] = value
                    winner[r, c] = k
    if constant_profile:
        rho, soft = density[0], softness[0]
        for r in range(box_r0, box_r1):
            for c in range(box_c0, box_c1):
                if coverage[r, c] > 0:
                    coverage[r, c] = rho * coverage[r, c] ** soft
    return box_r0, box_r1, box_c0, box_c1


@njit(cache=True, fastmath=True, error_model="numpy", boundscheck=False)
def _render_painting(
    points: Array, radius: Array, density: Array, softness: Array, color: Array, image: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """Lay every stroke on ``image`` in place; return the fragments."""
    n_strokes, channels = color.shape
    height, width = image.shape[0], image.shape[1]
    coverage = np.zeros((height, width), points.dtype)
    winner = np.zeros((height, width), np.int32)
    start = np.zeros(n_strokes + 1, np.int64)
    room = 1024
    pixel = np.empty(room, np.int32)
    segment = np.empty(room, np.int32)
    alpha = np.empty(room, points.dtype)
    below = np.empty((room, channels), points.dtype)
    count = 0
    for s in range(n_strokes):
        r0, r1, c0, c1 = _rasterize_stroke(
            points[s], radius[s], density[s], softness[s], coverage, winner, height, width
        )
        needed = count + max(r1 - r0, 0) * max(c1 - c0, 0)
        if needed > room:
            room = max(needed, 2 * room)
            grown_pixel = np.empty(room, np.int32)
            grown_segment = np.empty(room, np.int32)
            grown_alpha = np.empty(room, points.dtype)
            grown_below = np.empty((room, channels), points.dtype)
            grown_pixel[:count] = pixel[:count]
            grown_segment[:count] = segment[:count]
            grown_alpha[:count] = alpha[:count]
            grown_below[:count] = below[:count]
            pixel, segment, alpha, below = grown_pixel, grown_segment, grown_alpha, grown_below
        for r in range(r0, r1):
            for c in range(c0, c1):
                a = coverage[r, c]
                if a > 0:
                    pixel[count] = r * width + c
                    segment[count] = winner[r, c]
                    alpha[count] = a
                    for ch in range(channels):
                        under = image[r, c, ch]
                        below[count, ch] = under
                        image[r, c, ch] = under + a * (color[s, ch] - under)
                    count += 1
                    coverage[r, c] = 0
        start[s + 1] = count
    return start, pixel[:count], segment[:count], alpha[:count], below[:count]


@njit(cache=True, fastmath=True, error_model="numpy", boundscheck=False)
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
    n_strokes, channels = color.shape
    n_points = points.shape[1]
    one, zero = points.dtype.type(1.0), points.dtype.type(0.0)
    for s in range(n_strokes - 1, -1, -1):
        for f in range(start[s], start[s + 1]):
            p = pixel[f]
            a = alpha[f]
            g_alpha = zero
            for ch in range(channels):
                g = g_image[p, ch]
                g_alpha += g * (color[s, ch] - below[f, ch])
                g_color[s, ch] += g * a
                g_image[p, ch] = g * (one - a)
            if g_alpha == zero:
                continue
            k = segment[f]
            j = min(k + 1, n_points - 1)
            row = p // width
            ux, uy = points[s, k, 0], points[s, k, 1]
            ex, ey = points[s, j, 0] - ux, points[s, j, 1] - uy
            gx, gy = (p - row * width) - ux, row - uy
            length2 = ex * ex + ey * ey
            inverse = one / max(length2, points.dtype.type(_LENGTH_EPSILON))
            t_free = (gx * ex + gy * ey) * inverse
            t = min(max(t_free, zero), one)
            wx, wy = gx - t * ex, gy - t * ey
            d = np.sqrt(wx * wx + wy * wy)
            rad_free = radius[s, k] + t * (radius[s, j] - radius[s, k])
            rad = max(rad_free, points.dtype.type(R_MIN))
            q_free = one - d / rad
            q = max(q_free, points.dtype.type(Q_MIN))
            rho = density[s, k] + t * (density[s, j] - density[s, k])
            soft = softness[s, k] + t * (softness[s, j] - softness[s, k])
            power = a / rho if rho != zero else q**soft
            g_rho = g_alpha * power
            g_soft = g_alpha * a * np.log(q)
            g_q = zero
            if q_free > points.dtype.type(Q_MIN):
                g_q = g_alpha * soft * a / q
            g_d = -g_q / rad
            g_rad = g_q * d / (rad * rad)
            if rad_free <= points.dtype.type(R_MIN):
                g_rad = zero
            g_density[s, k] += (one - t) * g_rho
            g_density[s, j] += t * g_rho
            g_softness[s, k] += (one - t) * g_soft
            g_softness[s, j] += t * g_soft
            g_radius[s, k] += (one - t) * g_rad
            g_radius[s, j] += t * g_rad
            # D is stationary in T wherever T is free, so the distance pulls on the ends by their share alone.
            if d > zero:
                nx, ny = g_d * wx / d, g_d * wy / d
                g_points[s, k, 0] -= (one - t) * nx
                g_points[s, k, 1] -= (one - t) * ny
                g_points[s, j, 0] -= t * nx
                g_points[s, j, 1] -= t * ny
            if zero < t_free < one and length2 > points.dtype.type(_LENGTH_EPSILON):
                g_t = (
                    g_rad * (radius[s, j] - radius[s, k])
                    + g_rho * (density[s, j] - density[s, k])
                    + g_soft * (softness[s, j] - softness[s, k])
                ) * inverse
                vx, vy = gx - (t + t) * ex, gy - (t + t) * ey
                g_points[s, j, 0] += g_t * vx
                g_points[s, j, 1] += g_t * vy
                g_points[s, k, 0] -= g_t * (ex + vx)
                g_points[s, k, 1] -= g_t * (ey + vy)


def render(
    points: Array, radius: Array, density: Array, softness: Array, color: Array, canvas: Array
) -> tuple[Array, Fragments]:
    """Lay strokes on canvases, in order.

    Args:
        points: float[B, S, N, 2], path points in pixel coordinates (column, row).
        radius: float[B, S, N], half the stroke's width [px].
        density: float[B, S, N], coverage at the centre of the path, 0 to 1.
        softness: float[B, S, N], the exponent c: 0 gives a hard disc, 1 a cone.
        color: float[B, S, C], linear light.
        canvas: float[B, H, W, C], linear light; left as it is.

    Returns:
        The images, float[B, H, W, C], and the fragments that ``render_backward`` needs.

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
    """Gradients of a loss with respect to all inputs of ``render``, from ∂loss/∂image float[B, H, W, C]."""
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
            f"The renderer needs points [B, S, N, 2] and a canvas [B, H, W, C]; got {points.shape} and {canvas.shape}."
        )
    batch, strokes, n, _ = points.shape
    wanted = {
        "radius": (radius, (batch, strokes, n)),
        "density": (density, (batch, strokes, n)),
        "softness": (softness, (batch, strokes, n)),
        "color": (color, (batch, strokes, canvas.shape[-1])),
        "canvas": (canvas, (batch, *canvas.shape[1:])),
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
