"""Compositing of a stroke's fragments onto the canvas, and its gradient.

Without pickup, each fragment is alpha-composited in linear light:

    image ← below + a (colour − below)

With pickup κ, the tool mixes in wet paint where it crosses it, and carries it along the path. At a fragment g of the
path's segment k

    colour_g = colour + κ w_g (below_g − colour) + κ Σ_f a_f w_f (below_f − colour) / Σ_f a_f,

with sums over the fragments f of segments 0 … k, the coverage a_f of a fragment and the wetness w_f of the canvas
there, 0 to 1. Wetness is the canvas's fourth channel. Strokes are composited onto it with the value 1, so fresh paint
is wet for the next stroke.
"""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from pentimento.render.coverage import compiled

Array = NDArray[Any]
_MIN_COVERAGE = 1e-12
"""Floor under a sum of coverages, against division by zero."""


@compiled
def compose(
    color: Array, column: Array, row: Array, coverage: Array, below: Array, first: int, end: int, image: Array
) -> None:
    """Composite the fragments first:end in one colour [3] onto ``image`` [rows, W, 3]; set ``below`` to the ground."""
    red, green, blue = color[0], color[1], color[2]
    for f in range(first, end):
        pixel, under, a = image[row[f], column[f]], below[f], coverage[f]
        r, g, b = pixel[0], pixel[1], pixel[2]
        under[0], under[1], under[2] = r, g, b
        pixel[0], pixel[1], pixel[2] = r + a * (red - r), g + a * (green - g), b + a * (blue - b)


@compiled
def compose_backward(
    color: Array,
    column: Array,
    row: Array,
    coverage: Array,
    below: Array,
    first: int,
    end: int,
    g_image: Array,
    g_coverage: Array,
    g_color: Array,
) -> None:
    """Gradients of ``compose``: ``g_image`` [rows, W, 3] changes from the gradient after to that before the stroke.

    ``g_coverage[f − first]`` is set, ``g_color`` [3] added to.
    """
    red, green, blue = color[0], color[1], color[2]
    g_red = g_green = g_blue = coverage.dtype.type(0.0)
    one = coverage.dtype.type(1.0)
    for f in range(first, end):
        pixel, under, a = g_image[row[f], column[f]], below[f], coverage[f]
        r, g, b = pixel[0], pixel[1], pixel[2]
        g_coverage[f - first] = r * (red - under[0]) + g * (green - under[1]) + b * (blue - under[2])
        g_red += r * a
        g_green += g * a
        g_blue += b * a
        left = one - a
        pixel[0], pixel[1], pixel[2] = r * left, g * left, b * left
    g_color[0] += g_red
    g_color[1] += g_green
    g_color[2] += g_blue


@compiled
def carried_colors(
    color: Array, segment: Array, coverage: Array, below: Array, first: int, end: int, carried: Array
) -> None:
    """Fill ``carried`` [K, 4] with cumulative sums up to each segment: a w (below − colour), and a."""
    carried[:] = 0
    for f in range(first, end):
        sums, under, a = carried[segment[f]], below[f], coverage[f]
        weight = a * under[3]
        for i in range(3):
            sums[i] += weight * (under[i] - color[i])
        sums[3] += a
    for k in range(1, carried.shape[0]):
        for i in range(4):
            carried[k, i] += carried[k - 1, i]


@compiled
def compose_carrying(
    color: Array,
    pickup: float,
    column: Array,
    row: Array,
    segment: Array,
    coverage: Array,
    below: Array,
    first: int,
    end: int,
    image: Array,
    carried: Array,
) -> None:
    """``compose`` for a tool that picks up wet paint, on ``image`` [rows, W, 4]. ``carried`` [K, 4] is scratch."""
    minimum, one = coverage.dtype.type(_MIN_COVERAGE), coverage.dtype.type(1.0)
    for f in range(first, end):
        below[f] = image[row[f], column[f]]
    carried_colors(color, segment, coverage, below, first, end, carried)
    for f in range(first, end):
        pixel, under, a, sums = image[row[f], column[f]], below[f], coverage[f], carried[segment[f]]
        share, stirred = pickup / max(sums[3], minimum), pickup * under[3]
        for i in range(3):
            pixel[i] = under[i] + a * ((one - stirred) * (color[i] - under[i]) + share * sums[i])
        pixel[3] = under[3] + a * (one - under[3])


@compiled
def compose_carrying_backward(
    color: Array,
    pickup: float,
    column: Array,
    row: Array,
    segment: Array,
    coverage: Array,
    below: Array,
    first: int,
    end: int,
    g_image: Array,
    g_coverage: Array,
    g_color: Array,
    carried: Array,
    g_carried: Array,
) -> float:
    """Gradients of ``compose_carrying``, in the form of ``compose_backward``. Returns that of ``pickup``.

    ``carried`` and ``g_carried`` [K, 4] are scratch.
    """
    zero, one, minimum = coverage.dtype.type(0.0), coverage.dtype.type(1.0), coverage.dtype.type(_MIN_COVERAGE)
    carried_colors(color, segment, coverage, below, first, end, carried)
    g_carried[:] = 0  # first ∂loss/∂colour_k in 0:3, then ∂loss/∂sums
    g_pickup = zero
    for f in range(first, end):
        pixel, under, a, k = g_image[row[f], column[f]], below[f], coverage[f], segment[f]
        share, stirred = pickup / max(carried[k, 3], minimum), pickup * under[3]
        g_a, stirring = pixel[3] * (one - under[3]), zero
        for i in range(3):
            g_a += pixel[i] * ((one - stirred) * (color[i] - under[i]) + share * carried[k, i])
            stirring += a * pixel[i] * (under[i] - color[i])
            g_carried[k, i] += pixel[i] * a
            g_color[i] -= a * stirred * pixel[i]  # of the direct term
            pixel[i] *= one - a * (one - stirred)
        g_pickup += stirring * under[3]
        pixel[3] = pixel[3] * (one - a) + stirring * pickup
        g_coverage[f - first] = g_a
    for k in range(carried.shape[0] - 1, -1, -1):
        inverse = one / max(carried[k, 3], minimum)
        for i in range(3):
            g_color[i] += g_carried[k, i]
            pulled = g_carried[k, i] * carried[k, i] * inverse
            g_pickup += pulled
            if carried[k, 3] > minimum:
                g_carried[k, 3] -= pickup * pulled * inverse
            g_carried[k, i] *= pickup * inverse
        if k + 1 < carried.shape[0]:  # a sum up to k is part of all later sums
            for i in range(4):
                g_carried[k, i] += g_carried[k + 1, i]
    for f in range(first, end):
        pixel, under, a, sums = g_image[row[f], column[f]], below[f], coverage[f], g_carried[segment[f]]
        g_a, g_wet = sums[3], zero
        for i in range(3):
            through = sums[i] * (under[i] - color[i])
            g_a += under[3] * through
            g_wet += a * through
            pixel[i] += a * under[3] * sums[i]
            g_color[i] -= a * under[3] * sums[i]
        pixel[3] += g_wet
        g_coverage[f - first] += g_a
    return g_pickup
