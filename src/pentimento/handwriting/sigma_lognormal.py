"""The sigma-lognormal model of handwriting (Plamondon 1995; O'Reilly & Plamondon 2009).

A stroke is a sum of ballistic movements, each with a lognormal bell of speed along an arc. Two that overlap in time
give the smooth corner that a hand makes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

FloatArray = NDArray[np.float64]

_REACH = 3.0
"""Standard deviations of ln t after which a movement is over: what is left is a thousandth of it."""


class Movement(NamedTuple):
    """One ballistic movement."""

    length_m: float
    begins_s: float
    mu: float
    """Mean of ln(t in seconds since its beginning)."""
    sigma: float
    """Standard deviation of the same."""
    from_rad: float
    to_rad: float
    """Its heading at the beginning and at the end, between which it turns as it goes."""


def trajectory(movements: Sequence[Movement], rate_hz: float) -> FloatArray:
    """[K, 3] t_s, x_m, y_m from the origin until the last movement is over."""
    over = max(m.begins_s + math.exp(m.mu + _REACH * m.sigma) for m in movements)
    t = np.arange(math.ceil(over * rate_hz) + 1) / rate_hz
    place = np.zeros((len(t), 2))
    for movement in movements:
        place += _along(movement, t)
    return np.column_stack([t, place])


def _along(movement: Movement, t: FloatArray) -> FloatArray:
    """[K, 2] the way that one movement adds; exact, since share and heading are functions of one another."""
    since = np.maximum(t - movement.begins_s, 1e-12)
    share = 0.5 * (1 + erf((np.log(since) - movement.mu) / (movement.sigma * math.sqrt(2))))
    turn = movement.to_rad - movement.from_rad
    if abs(turn) < 1e-9:
        way = share[:, None] * np.array([math.cos(movement.from_rad), math.sin(movement.from_rad)])
    else:
        heading = movement.from_rad + turn * share
        way = np.column_stack([
            np.sin(heading) - math.sin(movement.from_rad), math.cos(movement.from_rad) - np.cos(heading),
        ]) / turn  # fmt: skip
    return np.asarray(movement.length_m * way)
