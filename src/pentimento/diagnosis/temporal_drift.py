"""What wanders from one action to the next: a state that nobody recorded.

A temperature that no sensor reads, a paint that thickens, a slab that settles: neighbours in the order of execution
then miss alike. Repeats of one action, made at different times, differ by it, so that a floor read off their spread
holds it (GAP.md, rule 6): to a model that is told the state it would be no noise. Here it is told apart from noise by
the covariance of neighbours, and what of it the repeats hold is taken off the floor.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.strokes.modes import levelled, permuted_actions

Array = NDArray[Any]

_DRAWS = 1999
_P = 0.01
_MIN = 0.05
"""Of the error: what is worth less may be what a base lacks where neighbours share a load of paint or a surface."""
_TINY = 1e-12


class TemporalDrift(NamedTuple):
    """A mode of the residual that wanders."""

    mode: str
    p: float
    mse: float
    """What it is worth: mean squared error of rows, sRGB in [0, 1] or mm²."""
    mse_of_repeats: float
    """How much of that the spread of repeats holds."""
    amount: Array
    """[B] of the mode in each row's residual, in robust standard deviations, in the order of execution."""


def temporal_drift(
    modes: Sequence[str], scores: Array, energy: Array, error: float, action: Array, turn: Array, seed: int
) -> TemporalDrift | None:
    """The mode in which neighbours in time are most alike, by permutation of actions, max-T over the modes; None where
    none is, beyond chance.

    Args:
        modes: names, [M].
        scores: amount of each mode in each row's residual, [B, M].
        energy: what one unit of each is worth in the row's error, [B, M].
        error: mean over the rows.
        action: rows of one value repeat one command, [B].
        turn: place of each row in the order of execution, 0 to B - 1, [B].
        seed: of the permutations.
    """
    amounts, weight, spread = levelled(scores, energy)
    amounts = amounts - (weight * amounts).sum(0) / weight.sum(0)
    order = np.argsort(turn)
    pairs = np.stack([order[:-1], order[1:]])
    pairs = pairs[:, action[pairs[0]] != action[pairs[1]]]  # else what an action's rows share would pass for it
    if not pairs.size:
        return None
    root = np.sqrt(weight)
    own = np.maximum(np.square(root * amounts).mean(0), _TINY)

    def alike(rows: Array) -> Array:
        return np.asarray((root * amounts)[rows[pairs]].prod(0).mean(0) / own)

    observed = alike(np.arange(len(action)))
    orders = permuted_actions(action, _DRAWS, np.random.default_rng([seed, 15]))
    largest = np.array([alike(rows).max() for rows in orders])
    m = int(np.argmax(observed))
    p = float((1 + (largest >= observed[m]).sum()) / (_DRAWS + 1))

    def worth(pairs: Array) -> float:
        weights = weight[:, m][pairs].prod(0)
        covariance = (weights * amounts[:, m][pairs].prod(0)).sum() / weights.sum()
        return max(float(covariance * spread[m] ** 2 * energy[:, m].mean()), 0.0)

    whole = worth(pairs)
    if p >= _P or whole <= _MIN * error:
        return None
    apart = _at_the_times_of_repeats(action, order)
    of_repeats = max(whole - worth(apart), 0.0) if apart.size else 0.0
    return TemporalDrift(modes[m], p, whole, of_repeats, amounts[order, m])


def _at_the_times_of_repeats(action: Array, order: Array) -> Array:
    """Pairs of rows [2, K], of other actions, that lie as far apart in time as repeats of one do: a repeat, and what
    came just before or after another.
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
