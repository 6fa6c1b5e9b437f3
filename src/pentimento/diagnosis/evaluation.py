"""What is measured on held-out actions: the three splits, and the noise floor (docs/diagnosis.md §2 and §7)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.contracts.statistics import interval, resamples

Array = NDArray[Any]

_FEWEST_ACTIONS = 12
"""Below it, three splits are too small for any test."""
_FEWEST_REPEATED = 6
"""From this number on, repeated actions go to the test split first."""
_TEST = 0.2
"""Share of the actions in the test split."""
_CONFIRMATION = 0.2
"""Share of the actions in the confirmation split."""
MIN_REPEATED = 3
"""Repeated actions that a noise floor needs."""
_DRAWS = 1999
"""Resamples of an interval."""
SMALLEST_GAP = 0.1
"""Lower bound of a denominator: a gap as a share of the error, a resampled gap as a share of the gap."""


class Actions(Protocol):
    """Rows of a table, as far as splitting needs them."""

    @property
    def action(self) -> Array:
        """int64[B]: rows of equal value repeat one command."""

    @property
    def block(self) -> Array:
        """int64[B]: rows of equal value should stay in one split."""


class Splits(NamedTuple):
    """Row indices; all rows of one action are in one split."""

    discovery: Array
    confirmation: Array
    test: Array


def split(measured: Actions, seed: int) -> Splits:
    """Split rows into 60 % discovery, 20 % confirmation and 20 % test, by action.

    Repeated actions go to the test split first, because the noise floor is read from them. Blocks (strokes between two
    dips, pushes between two smoothings) stay together as far as their actions allow.

    Raises:
        ContractError: too few actions for three splits.
    """
    actions, first, count = np.unique(measured.action, return_index=True, return_counts=True)
    if len(actions) < _FEWEST_ACTIONS:
        raise ContractError(
            f"The table has {len(actions)} different actions; to find, confirm and test a cause on different strokes "
            f"takes at least {_FEWEST_ACTIONS}, and to find anything but a large effect about 60."
        )
    rng = np.random.default_rng([seed, 7])
    repeated = actions[count > 1] if (count > 1).sum() >= _FEWEST_REPEATED else actions[:0]
    wanted = max(round(_TEST * len(actions)), 3)
    test = rng.permutation(repeated)[:wanted]
    left = np.setdiff1d(actions, test)
    block = measured.block[first[np.searchsorted(actions, left)]]
    order = rng.permutation(np.unique(block))
    by_block = [left[block == b] for b in order]
    taken = np.concatenate(by_block)
    if len(test) < wanted:
        test, taken = np.concatenate([test, taken[: wanted - len(test)]]), taken[wanted - len(test) :]
    confirming = max(round(_CONFIRMATION * len(actions)), 3)
    parts = taken[confirming:], taken[:confirming], test
    return Splits(*(np.flatnonzero(np.isin(measured.action, part)) for part in parts))


class Floor(NamedTuple):
    """Mean squared error of rows around the mean of their action: sRGB in [0, 1], or mm²."""

    mse: float
    interval: tuple[float, float]
    """95 % interval, by resampling actions."""

    @property
    def standard_error(self) -> float:
        """Standard error under normality: a quarter of the interval."""
        return (self.interval[1] - self.interval[0]) / 4

    def moved(self, by: float) -> Floor:
        """The floor shifted by an amount, so that its interval does not go below 0."""
        low, high = self.interval
        by = max(by, -low)
        return Floor(self.mse + by, (low + by, high + by))


def floor_of_repeats(rest: Array, valid: Array, groups: Sequence[Array], seed: int) -> Floor | None:
    """The floor from residuals [B, H, W, ...] and groups of rows of one action each; None with too few groups.

    Only pixels count that are ``valid`` [B, H, W] in all rows of an action; all other residuals are 0.
    """
    values = repeat_variances(rest, valid, groups)
    if len(values) < MIN_REPEATED:
        return None
    return weighted_floor(values, np.ones(len(values)), seed)


def repeat_variances(rest: Array, valid: Array, groups: Sequence[Array]) -> Array:
    """Variance of the rows about the mean of their action, [K], one of each group of two rows or more."""
    found = []
    for rows in groups:
        if len(rows) < 2:
            continue
        seen = (valid[rows] > 0).all(0)
        own = rest[rows][:, seen]
        found.append(np.square(own - own.mean(0)).sum() / (len(rows) - 1) / own[0].size)
    return np.array(found)


def weighted_floor(values: Array, weights: Array, seed: int) -> Floor:
    """The weighted mean of variances [K], with its interval by resampling the actions of positive weight."""
    values, weights = values[weights > 0], weights[weights > 0]
    drawn = resamples(len(values), _DRAWS, [seed, 8])
    means = (weights * values)[drawn].sum(1) / weights[drawn].sum(1)
    return Floor(float((weights * values).sum() / weights.sum()), interval(means))


def mean_gain(gains: Array, seed: int) -> tuple[float, tuple[float, float]]:
    """The mean of gains by action [n], and its 95 % interval by resampling actions."""
    return float(gains.mean()), interval(gains[resamples(len(gains), _DRAWS, [seed, 12])].mean(1))


def fraction_of_gap(base: Array, extended: Array, floor: float) -> tuple[float, tuple[float, float]]:
    """(base - extended) / (base - floor) from errors by action [n], and its 95 % interval by resampling actions."""
    decrease, gap = base - extended, base - floor
    drawn = resamples(len(gap), _DRAWS, [11])
    shares = decrease[drawn].mean(1) / np.maximum(gap[drawn].mean(1), SMALLEST_GAP * gap.mean())
    return float(decrease.mean() / gap.mean()), interval(shares)
