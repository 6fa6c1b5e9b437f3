"""Unmodelled temporal drift: a residual mode that changes with the order of execution (docs/diagnosis.md §9)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.residual_structure import DRAWS, SIGNIFICANT_P, ModeScores, permuted_actions, standardised

Array = NDArray[Any]

_MIN_DRIFT = 0.05
"""Smallest drift, as a share of the error. A smaller one may be misfit that neighbours share (paint load, surface)."""
_TINY = 1e-12


class TemporalDrift(NamedTuple):
    """A residual mode that drifts with the order of execution."""

    mode: str
    p: float
    mse: float
    """Error due to the drift, mean over rows: sRGB in [0, 1] squared, or mm²."""
    mse_of_repeats: float
    """How much of that the variance of repeats contains."""
    amount: Array
    """[B] of the mode in each row's residual, in robust standard deviations, in the order of execution."""


def temporal_drift(
    modes: Sequence[str], scores: ModeScores, action: Array, *, turn: Array, seed: int
) -> TemporalDrift | None:
    """The mode with the strongest lag-1 autocovariance in the order of execution; None if it is not significant.

    A state that nobody recorded (temperature, thickening paint, settling material) makes neighbours in time deviate in
    the same way. Repeats of one action, executed at different times, differ by it, so a floor from their variance
    contains it. For a model that knew the state it would not be noise.

    Args:
        modes: names, [M].
        scores: of the modes.
        action: rows of equal value repeat one command, [B].
        turn: rank of each row in the order of execution, [B].
        seed: of the permutations.
    """
    robust = standardised(scores)
    weight = robust.weight
    amounts = robust.amounts - (weight * robust.amounts).sum(0) / weight.sum(0)
    order = np.argsort(turn)
    pairs = np.stack([order[:-1], order[1:]])
    pairs = pairs[:, action[pairs[0]] != action[pairs[1]]]  # rows of one action are correlated anyway
    if not pairs.size:
        return None
    root = np.sqrt(weight)
    own = np.maximum(np.square(root * amounts).mean(0), _TINY)

    def autocorrelation(rows: Array) -> Array:
        return np.asarray((root * amounts)[rows[pairs]].prod(0).mean(0) / own)

    observed = autocorrelation(np.arange(len(action)))
    orders = permuted_actions(action, DRAWS, np.random.default_rng([seed, 15]))
    largest = np.array([autocorrelation(rows).max() for rows in orders])
    m = int(np.argmax(observed))
    p = float((1 + (largest >= observed[m]).sum()) / (DRAWS + 1))

    def mse_of(pairs: Array) -> float:
        weights = weight[:, m][pairs].prod(0)
        covariance = (weights * amounts[:, m][pairs].prod(0)).sum() / weights.sum()
        return max(float(covariance * robust.spread[m] ** 2 * scores.energy[:, m].mean()), 0.0)

    whole = mse_of(pairs)
    if p >= SIGNIFICANT_P or whole <= _MIN_DRIFT * scores.error:
        return None
    apart = _at_the_times_of_repeats(action, order)
    of_repeats = max(whole - mse_of(apart), 0.0) if apart.size else 0.0
    return TemporalDrift(modes[m], p, whole, of_repeats, amounts[order, m])


def _at_the_times_of_repeats(action: Array, order: Array) -> Array:
    """Pairs of rows [2, K] of different actions that are as far apart in time as repeats of one action.

    Each pairs a row with a neighbour in time of another repeat of the row's action.
    """
    place = np.argsort(order)
    found = []
    for number in np.unique(action):
        rows = np.flatnonzero(action == number)
        for one in rows:
            for other in rows[rows != one]:
                beside = [order[k] for k in (place[other] - 1, place[other] + 1) if 0 <= k < len(order)]
                found += [(one, row) for row in beside if action[row] != number]
    return np.array(found).T
