"""The noise floor of pushes: what even a perfect model would miss, read off repeated actions (docs/diagnosis.md §7)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.evaluation import MIN_REPEATED, Floor, repeat_variances, weighted_floor
from pentimento.diagnosis.pushes.jacobian import action_losses, residual
from pentimento.diagnosis.pushes.measured import MeasuredPushes
from pentimento.diagnosis.pushes.noise import error_by_noise
from pentimento.dynamics.pushes.analytic import AnalyticPush

Array = NDArray[Any]


def noise_floor(model: AnalyticPush, measured: MeasuredPushes, seed: int) -> Floor | None:
    """What even a perfect model would miss, weighted as errors are, from repeated actions (docs/diagnosis.md §7), mm²;
    None where none is repeated.

    Of the *residuals*, so that what differs between repeats and is foretold (the surface below) is not noise.
    """
    _, spread = _spread_of_repeats(model, measured)
    return weighted_floor(spread, np.ones(len(spread)), seed) if len(spread) >= MIN_REPEATED else None


def floor_of_test_split(model: AnalyticPush, measured: MeasuredPushes, test_split: Array, seed: int) -> Floor | None:
    """The noise floor of the rows ``test_split``.

    A repeated action contributes its own spread. A single action contributes the mean of all repeated actions,
    corrected for what the same noise does on its surface.
    """
    repeated, spread = _spread_of_repeats(model, measured)
    if len(spread) < MIN_REPEATED:
        return None
    own = np.array([measured.action[rows[0]] in measured.action[test_split] for rows in repeated])
    single = np.setdiff1d(measured.action[test_split], [measured.action[rows[0]] for rows in repeated])
    noise = error_by_noise(model, measured, repeated)
    usual = np.mean([noise[rows].mean() for rows in repeated])
    more = [noise[measured.action == action].mean() - usual for action in single]
    floor = weighted_floor(spread, own + len(single) / len(spread), seed)
    return floor.moved(float(np.sum(more)) / int(own.sum() + len(single)))


def floor_while_searching(model: AnalyticPush, weighed: MeasuredPushes, discovery_split: Array, seed: int) -> float:
    """The noise floor, mm², weighted as errors are; at most the error of ``discovery_split``; 0 where unknown."""
    noise = noise_floor(model, weighed, seed)
    return min(noise.mse, float(action_losses(model, weighed.pick(discovery_split)).mean())) if noise else 0.0


def _spread_of_repeats(model: AnalyticPush, measured: MeasuredPushes) -> tuple[list[Array], Array]:
    """Rows of each repeated action whose windows lie alike, and how far these differ in what the model misses, mm² [K],
    weighted as errors are.
    """
    groups = [np.flatnonzero(measured.action == action) for action in np.unique(measured.action)]
    window = measured.samples.window_m
    aligned = [g for g in groups if len(g) > 1 and np.ptp(window[g], axis=0).max() < measured.scene.pixel_m / 2]
    rest = np.sqrt(measured.weight) * residual(model, measured)
    return aligned, repeat_variances(rest, measured.valid, aligned)
