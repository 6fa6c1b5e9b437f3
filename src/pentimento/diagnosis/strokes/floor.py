"""The noise floor: what even a perfect model would miss, read off repeated actions (GAP.md, rule 6)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.predict import Model, residual

Array = NDArray[Any]

FEWEST = 3
"""Repeated actions from which a floor can be read."""


class Floor(NamedTuple):
    """Mean squared error of rows around the mean of their action: sRGB in [0, 1], or mm²."""

    mse: float
    interval: tuple[float, float]
    """95 %, by resampling actions."""

    @property
    def standard_error(self) -> float:
        """As normal an error has it: a quarter of what is between the ends of the interval."""
        return (self.interval[1] - self.interval[0]) / 4

    def moved(self, by: float) -> Floor:
        """As much higher, or lower; no lower than where its interval begins at 0."""
        low, high = self.interval
        by = max(by, -low)
        return Floor(self.mse + by, (low + by, high + by))


def noise_floor(model: Model, measured: Measured, seed: int) -> Floor | None:
    """None where no action is repeated.

    Of the *residuals*, so that what differs between repeats and is foretold (ink used up, paint below) is not noise.
    """
    rest, valid = residual(model, measured), measured.samples.valid.numpy()
    groups = [np.flatnonzero(measured.action == action) for action in np.unique(measured.action)]
    return floor_of_repeats(rest, valid, [rows for rows in groups if (valid[rows] == valid[rows[0]]).all()], seed)


def floor_of_repeats(rest: Array, valid: Array, groups: Sequence[Array], seed: int) -> Floor | None:
    """``noise_floor`` from residuals [B, H, W, ...], 0 where not ``valid`` [B, H, W], and rows of one action each.

    Pixels count that are valid in all of an action's rows.
    """
    values = spreads(rest, valid, groups)
    if len(values) < FEWEST:
        return None
    return floor_of(values, np.ones(len(values)), seed)


def spreads(rest: Array, valid: Array, groups: Sequence[Array]) -> Array:
    """How far rows of one action differ from their mean, squared: [K], one of each group of two rows or more."""
    found = []
    for rows in groups:
        if len(rows) < 2:
            continue
        seen = (valid[rows] > 0).all(0)
        own = rest[rows][:, seen]
        found.append(np.square(own - own.mean(0)).sum() / (len(rows) - 1) / own[0].size)
    return np.array(found)


def floor_of(values: Array, weights: Array, seed: int) -> Floor:
    """The weighted mean of spreads [K], and between what it lies where the actions that count are drawn again."""
    values, weights = values[weights > 0], weights[weights > 0]
    drawn = np.random.default_rng([seed, 8]).choice(len(values), (1999, len(values)))
    means = (weights * values)[drawn].sum(1) / weights[drawn].sum(1)
    low, high = np.quantile(means, [0.025, 0.975])
    return Floor(float((weights * values).sum() / weights.sum()), (float(low), float(high)))
