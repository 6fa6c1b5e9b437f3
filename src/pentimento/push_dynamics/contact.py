"""Where a swept tool passes below a surface: one pass over the pixels of each push, compiled.

See ``analytic.py`` for the tool's lower envelope. Most pixels are far from it; nothing is computed there.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pentimento.push_dynamics.mechanisms.mechanism import Contact

Array = NDArray[Any]

_FAR = 30.0
"""In softnesses of the contact's edge: beyond it, there is contact, or there is none."""
_PEAK, _COLLAR = 0.4, 0.8
"""Widths of what is drawn up where the tool lifts off, and of what it is drawn from, in radii of the contact."""
_NO_PEAK = 6.0
"""Collars' widths from the end of travel beyond which nothing is drawn up."""


def contact_of(before: Array, along: Array, across: Array, moved: Array, knots: Array, fixed: Array) -> Contact:
    """The contact of B pushes.

    Args:
        before: float32[B, H, W] metres above the surface at the start of each push.
        along: float32[B, H, W] metres from the commanded start.
        across: float32[B, H, W] metres to the left of it.
        moved: float64[B, 7]: shift along, shift across, slope of the descent, depth at the start, length of travel,
            logarithm of the tool's width, radius of the contact at the end; metres.
        knots: float64[2, K]: distances from the tool's axis, and what is added to a ball's profile there; metres.
        fixed: float64[4]: radius of the ball, factor ahead of the tool, softness of the edge, half-width of the
            footprint; metres.
    """
    shape = before.shape
    made = Contact(*(np.zeros(shape, dtype=np.float32) for _ in Contact._fields))
    _touch(
        before, along, across, moved.astype(np.float32), knots.astype(np.float32), fixed.astype(np.float32), *made
    )  # fmt: skip
    return made


@njit(cache=True, error_model="numpy", nogil=True)
def _touch(
    before: Array,
    along: Array,
    across: Array,
    moved: Array,
    knots: Array,
    fixed: Array,
    pressed: Array,
    inside: Array,
    beyond_end: Array,
    progress: Array,
    peak: Array,
) -> None:
    radius, aspect, edge, half_width = fixed
    one, last = np.float32(1), knots.shape[1] - 1
    rise = max((knots[1, last] - knots[1, last - 1]) / (knots[0, last] - knots[0, last - 1]), np.float32(0))
    share = np.float32((_PEAK / _COLLAR) ** 2)
    inner_rate, collar_rate = np.float32(-1 / (2 * _PEAK**2)), np.float32(-1 / (2 * _COLLAR**2))
    for b in range(before.shape[0]):
        shift, aside, slope, sunk, length, wider, end_radius = moved[b]
        narrower, middle = np.float32(math.exp(-wider)), length / 2
        for i in range(before.shape[1]):
            for j in range(before.shape[2]):
                u, v = along[b, i, j] - shift, across[b, i, j] - aside
                station = min(max(u + slope * radius, np.float32(0)), length)
                ahead = (u - station) * aspect
                distance = np.float32(math.sqrt(ahead * ahead + v * v)) * narrower
                envelope = distance * distance / (2 * radius) - slope * station - sunk
                if distance > knots[0, 0]:
                    k = 1
                    while k < last and distance > knots[0, k]:
                        k += 1
                    part = min((distance - knots[0, k - 1]) / (knots[0, k] - knots[0, k - 1]), one)
                    envelope += knots[1, k - 1] + part * (knots[1, k] - knots[1, k - 1])
                    envelope += rise * max(distance - knots[0, last], np.float32(0))
                else:
                    envelope += knots[1, 0]
                ratio = (before[b, i, j] - envelope) / edge
                if ratio > _FAR:
                    pressed[b, i, j], inside[b, i, j] = edge * ratio, one
                elif ratio > -_FAR:
                    decayed = np.float32(math.exp(-abs(ratio)))
                    pressed[b, i, j] = edge * (max(ratio, np.float32(0)) + np.float32(math.log1p(decayed)))
                    inside[b, i, j] = (one if ratio >= 0 else decayed) / (one + decayed)
                beyond = (u - length) / end_radius
                beyond_end[b, i, j] = beyond
                progress[b, i, j] = min(max((u - middle) / (middle + half_width), -one), one)
                squared = beyond * beyond + (v / end_radius) ** 2
                if squared < (_NO_PEAK * _COLLAR) ** 2:
                    drawn = math.exp(squared * inner_rate) - math.exp(squared * collar_rate) * share
                    peak[b, i, j] = np.float32(drawn) / (one - share)
