"""How what a model foretells of measured strokes changes with each of its numbers.

Marks by differences, from there to pixels by the imprint's own derivatives; paint and gain by central differences. All
numbers of a row share one pass over its pixels.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_STEP_RIDGE = 1e-8
_SEEN = 1e-10
"""Of the largest curvature: what lies below is not seen at all."""
_OPEN = 0.01
"""Directions of which a single action decides all but so little tell nothing about its scatter."""


class Statistics(NamedTuple):
    """All that tests, held-out gains, bootstraps and designs need of n actions (docs/diagnosis.md §3).

    Per pixel: divided by the number of a row's pixels, and averaged over an action's rows.
    """

    curvature: Array  # [n, P, P] J^T J
    slope: Array  # [n, P] J^T r
    energy: Array  # [n] r^T r

    def of(self, columns: Array) -> Statistics:
        """Of some of the numbers alone."""
        return Statistics(self.curvature[:, columns][:, :, columns], self.slope[:, columns], self.energy)


def by_action(values: Array, action: Array) -> Array:
    """Means over the rows of each action, in the order of the actions' numbers."""
    _, group, count = np.unique(action, return_inverse=True, return_counts=True)
    sums = np.zeros((len(count), *values.shape[1:]))
    np.add.at(sums, group, values)
    return sums / count.reshape(-1, *[1] * (values.ndim - 1))


def damped_step(
    now: Array, away: Array, statistics: Statistics, damping: float, hold: Array, low: Array, high: Array
) -> Array:
    """All numbers [P] after a step; those that would leave their range stay at its end.

    Args:
        away: how far each number is from its start.
        damping: of a number's own curvature.
        hold: curvature [P, P] of what holds the numbers near their start.
    """
    curvature = statistics.curvature.mean(0) + hold
    slope = statistics.slope.mean(0) - hold @ away
    diagonal = np.diag(curvature)
    damped = curvature + np.diag(damping * diagonal + _STEP_RIDGE * diagonal.max() + 1e-15)
    new, free = now, np.ones(len(slope), bool)
    for _ in range(len(slope)):
        moved = new[~free] - now[~free]
        step = np.linalg.solve(damped[np.ix_(free, free)], slope[free] - damped[np.ix_(free, ~free)] @ moved)
        new = new.copy()
        new[free] = now[free] + step
        outside = free & ((new < low) | (new > high))
        if not outside.any():
            break
        new = np.clip(new, low, high)
        free &= ~outside
    return new


def promised(step: Array, away: Array, statistics: Statistics, hold: Array) -> float:
    """How much lower a step makes what is minimised, to second order."""
    curvature = statistics.curvature.mean(0) + hold
    slope = statistics.slope.mean(0) - hold @ away
    return float(2 * slope @ step - step @ curvature @ step)


def covariance(statistics: Statistics) -> NDArray[np.float64]:
    """Of all numbers of a fitted model, [P, P]."""
    whole = statistics.curvature.sum(0)
    unit = 1 / np.sqrt(np.where(np.diag(whole) > 0, np.diag(whole), 1.0))  # in which each number is seen as well
    size, direction = np.linalg.eigh(whole * np.outer(unit, unit))
    seen = size > _SEEN * size[-1]
    half = unit[:, None] * direction[:, seen] / np.sqrt(size[seen])
    # In these directions what an action decides of each, its leverage, lies between nothing and all.
    open_share, own = np.linalg.eigh(np.eye(half.shape[1]) - half.T @ statistics.curvature @ half)  # [n, K], [n, K, K]
    factor = np.where(open_share > _OPEN, 1 / np.maximum(open_share, _OPEN), 0.0)
    score = np.einsum("nij,ni->nj", own, statistics.slope @ half) * factor
    left_out = np.einsum("nij,nj->ni", own, score) @ half.T  # [n, P]: by what leaving an action out moves each number
    return np.asarray(left_out.T @ left_out)
