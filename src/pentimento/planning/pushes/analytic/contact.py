"""Contact of a swept tool with a surface: one compiled pass over the pixels of each push.

The tool's lower envelope is defined in ``analytic.py``. Most pixels are far from the tool; nothing is computed there.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pentimento.planning.pushes.analytic.mechanisms.mechanism import Contact

Array = NDArray[Any]

_MIN_PIXELS = np.float32(0.5)
"""Minimum contact area at the end of the travel, in pixels."""
_FAR = np.float32(30)
"""Distance in softnesses of the contact edge beyond which the contact is taken as 0 or 1."""
_PEAK = 0.48
_COLLAR = 0.8
"""Widths of the peak that a tool draws up as it lifts off (``_PEAK``), and of the ring that the material comes from, in
radii of the contact."""
_TINY = np.float32(1e-12)
"""Avoids a division by zero on the tool's axis."""
_NO_PEAK = 3.5
"""Distance from the lift-off, in widths of the ring, beyond which nothing is drawn up."""
_TRANSITION = np.float32(0.15)
"""Width of the transition between the surface ahead of a tool and its own groove behind it, in radii of the contact."""


class Sweep(NamedTuple):
    """Path of a tool over B surfaces; lengths in metres."""

    before: Array
    """float32[B, H, W] above the surface at the start of each push."""
    along: Array
    """float32[B, H, W] from the commanded start."""
    across: Array
    """float32[B, H, W] to the left of it."""
    motion: Array
    """[B, 6]: shift along, shift across, slope of the descent, length of travel, logarithm of the tool's width, radius
    of the contact at the end on a level surface."""
    tip_depth: Array
    """[B, K]: depth of the tool's tip at K stations of its path, from start to end."""
    knots: Array
    """[2, K]: distances from the tool's axis, and offsets from a ball's profile there."""
    fixed: Array
    """[5]: radius of the ball, scale factor along the travel, reduction of the squared distance along a diagonal (0 for
    a round tool), softness of the edge, half-width of the footprint."""

    def single(self) -> Sweep:
        """Copy in single precision, as the compiled kernels expect."""
        return Sweep(*(values.astype(np.float32, copy=False) for values in self))


def contact_of(sweep: Sweep, pixel_m: float) -> Contact:
    """Contact of B pushes, on pixels of side ``pixel_m`` metres; ``heaped_m`` is still 0."""
    contact = Contact(*(np.zeros(sweep.before.shape, dtype=np.float32) for _ in Contact._fields))
    _touch(sweep.single(), np.float32(pixel_m), *contact[:4])
    return contact


@njit(cache=True, error_model="numpy", nogil=True)
def above_tip(distance: float, radius: float, knots: Array) -> float:
    """Height of a tool's underside above its tip, by distance from its axis; arguments as in ``Sweep``."""
    one, last = np.float32(1), knots.shape[1] - 1
    ball = distance * distance / (2 * radius)
    if distance <= knots[0, 0]:
        return ball + knots[1, 0]
    k = 1
    while k < last and distance > knots[0, k]:
        k += 1
    part = min((distance - knots[0, k - 1]) / (knots[0, k] - knots[0, k - 1]), one)
    more = knots[1, k - 1] + part * (knots[1, k] - knots[1, k - 1])
    if distance <= knots[0, last]:
        return ball + more
    rise = max((knots[1, last] - knots[1, last - 1]) / (knots[0, last] - knots[0, last - 1]), np.float32(0))
    return ball + more + rise * (distance - knots[0, last])


@njit(cache=True, error_model="numpy", nogil=True)
def _corner_distance(ahead: float, aside: float, corners: float) -> np.float32:
    """Distance from the tool's axis, reduced along the diagonals of a tool with corners."""
    squared = ahead * ahead + aside * aside
    return np.float32(math.sqrt(squared - corners * 4 * (ahead * aside) * (ahead * aside) / (squared + _TINY)))


@njit(cache=True, error_model="numpy", nogil=True)
def _logistic(ratio: np.float32) -> np.float32:
    """Logistic function, clipped at ``_FAR``."""
    one = np.float32(1)
    return one / (one + np.float32(math.exp(-min(max(ratio, -_FAR), _FAR))))


@njit(cache=True, error_model="numpy", nogil=True)
def _final_contact(
    before: Array,
    along: Array,
    across: Array,
    motion: Array,
    tip_depth: float,
    knots: Array,
    fixed: Array,
    pixel_m: float,
) -> tuple[np.float32, np.float32, np.float32]:
    """Centre of the contact at the end of the travel (along, across), and the radius of a disc of equal area.

    An older, deeper groove is not in contact. Behind a tool that travelled is its own groove, which counts less the
    farther the tool came.
    """
    one = np.float32(1)
    radius, aspect, corners, edge, _ = fixed
    shift, aside, _, length, wider, end_radius = motion
    narrower, behind = np.float32(math.exp(-wider)), end_radius / (2 * length + end_radius)
    reach2 = np.float32(4) * end_radius * end_radius
    area, sum_u, sum_v = _MIN_PIXELS, np.float32(0), np.float32(0)
    for i in range(before.shape[0]):
        for j in range(before.shape[1]):
            u, v = along[i, j] - shift - length, across[i, j] - aside
            if u * u + v * v > reach2:
                continue
            distance = _corner_distance(u * aspect, v, corners) * narrower
            ratio = (before[i, j] - above_tip(distance, radius, knots) + tip_depth) / edge
            if ratio < -_FAR:
                continue
            touching = _logistic(ratio) * (behind + (one - behind) * _logistic(u / (_TRANSITION * end_radius)))
            area += touching
            sum_u += touching * u
            sum_v += touching * v
    return length + sum_u / area, sum_v / area, np.float32(math.sqrt(area / math.pi)) * pixel_m


@njit(cache=True, error_model="numpy", nogil=True)
def _touch(sweep: Sweep, pixel_m: float, pressed: Array, inside: Array, beyond_end: Array, peak: Array) -> None:
    before, along, across, motion, tip_depth, knots, fixed = sweep
    radius, aspect, corners, edge, _ = fixed
    pieces = tip_depth.shape[1] - 1
    one = np.float32(1)
    share, farthest = np.float32((_PEAK / _COLLAR) ** 2), np.float32((_NO_PEAK * _COLLAR) ** 2)
    rate, inner_rate = np.float32(-1 / (2 * _COLLAR**2)), np.float32(-1 / (2 * _PEAK**2))
    lowest, roundness = knots[1].min(), one - max(corners, np.float32(0))
    for b in range(before.shape[0]):
        shift, aside, slope, length, wider, _ = motion[b]
        narrower = np.float32(math.exp(-wider))
        pieces_a_metre = np.float32(pieces) / max(length, np.float32(1e-6))
        middle_u, middle_v, rest_radius = _final_contact(
            before[b], along[b], across[b], motion[b], tip_depth[b, pieces], knots, fixed, pixel_m
        )
        per_radius = one / rest_radius
        # Beyond this, squared, no part of the tool comes down to the highest place.
        room = (
            2
            * radius
            * (before[b].max() + tip_depth[b].max() + _FAR * edge - lowest)
            / (roundness * narrower * narrower)
        )
        for i in range(before.shape[1]):
            for j in range(before.shape[2]):
                u, v = along[b, i, j] - shift, across[b, i, j] - aside
                beyond, beside = (u - middle_u) * per_radius, (v - middle_v) * per_radius
                beyond_end[b, i, j] = beyond
                squared = beyond * beyond + beside * beside
                if squared < farthest:
                    collar, inner = np.float32(math.exp(squared * rate)), np.float32(math.exp(squared * inner_rate))
                    peak[b, i, j] = (inner - share * collar) / (one - share)
                station = min(max(u + slope * radius, np.float32(0)), length)
                ahead = (u - station) * aspect
                squared = ahead * ahead + v * v
                if squared > room:
                    continue
                distance = _corner_distance(ahead, v, corners) * narrower
                place = min(station * pieces_a_metre, np.float32(pieces))
                piece = min(int(place), pieces - 1)
                lower = tip_depth[b, piece] + (place - piece) * (tip_depth[b, piece + 1] - tip_depth[b, piece])
                envelope = above_tip(distance, radius, knots) - lower
                ratio = (before[b, i, j] - envelope) / edge
                if ratio > _FAR:
                    pressed[b, i, j], inside[b, i, j] = edge * ratio, one
                elif ratio > -_FAR:
                    decayed = np.float32(math.exp(-abs(ratio)))
                    pressed[b, i, j] = edge * (max(ratio, np.float32(0)) + np.float32(math.log1p(decayed)))
                    inside[b, i, j] = (one if ratio >= 0 else decayed) / (one + decayed)
