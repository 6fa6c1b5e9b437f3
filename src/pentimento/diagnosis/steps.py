"""Damped Gauss-Newton steps within bounds, on the sums over actions that tests of causes need as well."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.strokes.jacobian import Statistics

Array = NDArray[Any]

_RIDGE = 1e-8


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
    damped = curvature + np.diag(damping * diagonal + _RIDGE * diagonal.max() + 1e-15)
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
