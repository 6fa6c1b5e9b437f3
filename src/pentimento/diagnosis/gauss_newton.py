"""Sums over actions for least squares: damped Gauss-Newton steps within bounds, and cluster-robust covariance.

Score tests, held-out gains, standard errors and designs use the same sums (docs/diagnosis.md §3).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_STEP_RIDGE = 1e-8
"""Ridge of a step, relative to the largest curvature. It keeps the linear system regular."""
_SEEN = 1e-10
"""Directions with less than this share of the largest curvature are not estimable and are left out."""
_OPEN = 0.01
"""Directions in which one action has a leverage above 1 minus this value have no leave-one-out score."""


class Statistics(NamedTuple):
    """Sums of n actions, or of n rows, for P parameters (docs/diagnosis.md §3).

    Each row's sums are divided by its number of pixels; those of an action are means over its rows.
    """

    curvature: Array  # [n, P, P] J^T J
    slope: Array  # [n, P] J^T r
    energy: Array  # [n] r^T r

    def of(self, columns: Array) -> Statistics:
        """The statistics of a subset of the parameters."""
        return Statistics(self.curvature[:, columns][:, :, columns], self.slope[:, columns], self.energy)


def by_action(values: Array, action: Array) -> Array:
    """Means over the rows of each action [n, ...], in the order of the action numbers."""
    _, group, count = np.unique(action, return_inverse=True, return_counts=True)
    sums = np.zeros((len(count), *values.shape[1:]))
    np.add.at(sums, group, values)
    return sums / count.reshape(-1, *[1] * (values.ndim - 1))


def damped_step(
    now: Array, away: Array, statistics: Statistics, *, damping: float, hold: Array, bounds: tuple[Array, Array]
) -> Array:
    """The parameters [P] after one Levenberg-Marquardt step; a parameter that would leave its range stays at its bound.

    Args:
        now: parameters [P].
        away: their distance [P] from the prior's mean.
        damping: share of each parameter's own curvature that is added to the diagonal.
        hold: curvature [P, P] of the Gaussian prior.
        bounds: lower and upper, [P] each.
    """
    low, high = bounds
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


def predicted_decrease(step: Array, away: Array, statistics: Statistics, hold: Array) -> float:
    """By how much a step lowers the penalised loss, to second order."""
    curvature = statistics.curvature.mean(0) + hold
    slope = statistics.slope.mean(0) - hold @ away
    return float(2 * slope @ step - step @ curvature @ step)


def covariance(statistics: Statistics) -> NDArray[np.float64]:
    """Cluster-robust covariance of all parameters of a fitted model, [P, P]; the cluster is the action.

    The sandwich is A^-1 (sum_i h_i h_i^T) A^-1 over actions i (Liang and Zeger 1986). Residuals of a fit are too small,
    the more so with few actions and many nuisances. Each score is therefore corrected to its leave-one-out value, h_i =
    (1 - A_i A^-1)^-1 g_i (CR3: Bell and McCaffrey 2002).
    """
    whole = statistics.curvature.sum(0)
    unit = 1 / np.sqrt(np.where(np.diag(whole) > 0, np.diag(whole), 1.0))  # scales parameters to equal curvature
    size, direction = np.linalg.eigh(whole * np.outer(unit, unit))
    seen = size > _SEEN * size[-1]
    half = unit[:, None] * direction[:, seen] / np.sqrt(size[seen])
    # In these directions the leverage of an action lies between 0 and 1.
    open_share, own = np.linalg.eigh(np.eye(half.shape[1]) - half.T @ statistics.curvature @ half)  # [n, K], [n, K, K]
    factor = np.where(open_share > _OPEN, 1 / np.maximum(open_share, _OPEN), 0.0)
    score = np.einsum("nij,ni->nj", own, statistics.slope @ half) * factor
    left_out = np.einsum("nij,nj->ni", own, score) @ half.T  # [n, P]: change by leaving the action out
    return np.asarray(left_out.T @ left_out)
