"""Intervals by bootstrap (Efron 1979): prompts are drawn again and again, all methods of a prompt together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_LEVELS = (0.025, 0.975)


@dataclass(frozen=True)
class Estimate:
    """A number, and where 95 % of the resampled ones lie."""

    value: float
    low: float
    high: float


def resamples(count: int, times: int, seed: int) -> NDArray[np.int64]:
    """[times, count] numbers of prompts, drawn with replacement."""
    return np.random.default_rng([seed, count, times]).integers(count, size=(times, count))


def mean_estimate(values: FloatArray, drawn: NDArray[np.int64]) -> Estimate | None:
    """Mean [B] over prompts; NaN values are left out. None where nothing else is there."""
    if np.isnan(values).all():
        return None
    return estimate(lambda chosen: _mean(values[chosen]), drawn)


def estimate(statistic: Callable[[NDArray[np.int64]], float], drawn: NDArray[np.int64]) -> Estimate | None:
    """Any statistic of prompts, given as a function of their numbers; None where it has no finite value.

    Resamples in which the statistic is not finite (a ratio over nothing) are left out of the interval.
    """
    value = statistic(np.arange(drawn.shape[1]))
    found = np.array([statistic(chosen) for chosen in drawn])
    found = found[np.isfinite(found)]
    if not np.isfinite(value) or not len(found):
        return None
    low, high = np.quantile(found, _LEVELS)
    return Estimate(float(value), float(low), float(high))


def gap_closed(base: FloatArray, fine: FloatArray, oracle: FloatArray, drawn: NDArray[np.int64]) -> Estimate | None:
    """(Δ_base − Δ_fine) / (Δ_base − Δ_oracle) of means over prompts: 1 where fine-tuning reaches the oracle."""

    def share(chosen: NDArray[np.int64]) -> float:
        reachable = _mean(base[chosen]) - _mean(oracle[chosen])
        return (_mean(base[chosen]) - _mean(fine[chosen])) / reachable if reachable > 0 else float("nan")

    return estimate(share, drawn)


def ratio(over: FloatArray, under: FloatArray, drawn: NDArray[np.int64]) -> Estimate | None:
    """Ratio of two means over prompts."""

    def of_means(chosen: NDArray[np.int64]) -> float:
        below = _mean(under[chosen])
        return _mean(over[chosen]) / below if below > 0 else float("nan")

    return estimate(of_means, drawn)


def difference(one: FloatArray, other: FloatArray, drawn: NDArray[np.int64]) -> Estimate | None:
    """Mean over prompts of what one has more than the other."""
    return estimate(lambda chosen: _mean(one[chosen] - other[chosen]), drawn)


def _mean(values: FloatArray) -> float:
    known = values[~np.isnan(values)]
    return float(known.mean()) if len(known) else float("nan")
