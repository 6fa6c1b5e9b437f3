"""The percentile bootstrap (Efron 1979): intervals of statistics whose items are drawn again with replacement."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Resamples = NDArray[np.int64]
"""[draws, n] indices of items; each row is one resample."""

_LEVELS: Final = (0.025, 0.975)  # of a 95 % interval
_ITEM_DRAWS: Final = 2000  # resamples of held-out items: the interval's ends are stable to about 2 % of its width


@dataclass(frozen=True)
class Estimate:
    """A statistic and its 95 % interval."""

    value: float
    low: float
    high: float


def resamples(count: int, draws: int, key: Sequence[int]) -> Resamples:
    """[draws, count] indices below `count`, drawn with replacement by the generator of `key`."""
    return np.random.default_rng(key).integers(count, size=(draws, count))


def item_resamples(count: int, seed: int) -> Resamples:
    """[2000, count] resamples of held-out items, the same for each method and metric: comparisons are paired."""
    return resamples(count, _ITEM_DRAWS, [seed, count, _ITEM_DRAWS])


def interval(values: FloatArray) -> tuple[float, float]:
    """The 95 % percentile interval of a statistic's values [draws] over resamples."""
    low, high = np.quantile(values, _LEVELS)
    return float(low), float(high)


def estimate(statistic: Callable[[NDArray[np.int64]], float], drawn: Resamples) -> Estimate | None:
    """A statistic of items, given as a function of their indices; None if it has no finite value.

    Resamples in which the statistic is not finite (a ratio over zero) do not count towards the interval.
    """
    value = statistic(np.arange(drawn.shape[1]))
    values = np.array([statistic(indices) for indices in drawn])
    values = values[np.isfinite(values)]
    return Estimate(float(value), *interval(values)) if np.isfinite(value) and len(values) else None


def mean_estimate(values: FloatArray, drawn: Resamples) -> Estimate | None:
    """Mean of values [n] over items, without NaN; None if every value is NaN."""
    return estimate(lambda indices: _mean(values[indices]), drawn)


def difference(one: FloatArray, other: FloatArray, drawn: Resamples) -> Estimate | None:
    """Mean of `one` - `other` over the same items, both [n]."""
    return estimate(lambda indices: _mean(one[indices] - other[indices]), drawn)


def ratio(over: FloatArray, under: FloatArray, drawn: Resamples) -> Estimate | None:
    """Mean of `over` divided by the mean of `under`, both [n]."""

    def of_means(indices: NDArray[np.int64]) -> float:
        below = _mean(under[indices])
        return _mean(over[indices]) / below if below > 0 else float("nan")

    return estimate(of_means, drawn)


def gap_closed(base: FloatArray, fine: FloatArray, oracle: FloatArray, drawn: Resamples) -> Estimate | None:
    """(Δ_base - Δ_fine) / (Δ_base - Δ_oracle) of means over items: 1 where the fine-tuned method equals the oracle."""

    def fraction(indices: NDArray[np.int64]) -> float:
        reachable = _mean(base[indices]) - _mean(oracle[indices])
        return (_mean(base[indices]) - _mean(fine[indices])) / reachable if reachable > 0 else float("nan")

    return estimate(fraction, drawn)


def _mean(values: FloatArray) -> float:
    known = values[~np.isnan(values)]
    return float(known.mean()) if len(known) else float("nan")
