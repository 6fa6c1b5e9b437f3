"""What is measured on the test split: noise floor, gains, and the fraction of the gap closed (docs/diagnosis.md §7)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.statistics import interval, resamples

Array = NDArray[Any]

MIN_REPEATED = 3
"""Repeated actions that a noise floor needs."""
_DRAWS = 1999
"""Resamples of an interval."""
SMALLEST_GAP = 0.1
"""Lower bound of a denominator: a gap as a share of the error, a resampled gap as a share of the gap."""


class Floor(NamedTuple):
    """Mean squared error of rows around the mean of their action: sRGB in [0, 1], or mm²."""

    mse: float
    interval: tuple[float, float]
    """95 % interval, by resampling actions."""

    def moved(self, by: float) -> Floor:
        """The floor shifted by an amount, so that its interval does not go below 0."""
        low, high = self.interval
        by = max(by, -low)
        return Floor(self.mse + by, (low + by, high + by))


def floor_of_repeats(rest: Array, valid: Array, groups: Sequence[Array], seed: int) -> Floor | None:
    """The floor from residuals [B, H, W, ...] and groups of rows of one action each; None with too few groups.

    Only pixels count that are ``valid`` [B, H, W] in all rows of an action; all other residuals are 0.
    """
    found = []
    for rows in groups:
        if len(rows) < 2:
            continue
        seen = (valid[rows] > 0).all(0)
        own = rest[rows][:, seen]
        found.append(np.square(own - own.mean(0)).sum() / (len(rows) - 1) / own[0].size)
    if len(found) < MIN_REPEATED:
        return None
    variances = np.array(found)
    means = variances[resamples(len(variances), _DRAWS, [seed, 8])].mean(1)
    return Floor(float(variances.mean()), interval(means))


def mean_gain(gains: Array, seed: int) -> tuple[float, tuple[float, float]]:
    """The mean of gains by action [n], and its 95 % interval by resampling actions."""
    return float(gains.mean()), interval(gains[resamples(len(gains), _DRAWS, [seed, 12])].mean(1))


def fraction_of_gap(base: Array, extended: Array, floor: float) -> tuple[float, tuple[float, float]]:
    """(base - extended) / (base - floor) from errors by action [n], and its 95 % interval by resampling actions."""
    decrease, gap = base - extended, base - floor
    drawn = resamples(len(gap), _DRAWS, [11])
    shares = decrease[drawn].mean(1) / np.maximum(gap[drawn].mean(1), SMALLEST_GAP * gap.mean())
    return float(decrease.mean() / gap.mean()), interval(shares)
