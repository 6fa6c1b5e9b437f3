"""Levenberg-Marquardt steps on linear problems with known solution."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from pentimento.diagnosis.gauss_newton import Statistics, damped_step, predicted_decrease

NUMBERS = 5
FREE = np.full(NUMBERS, -np.inf), np.full(NUMBERS, np.inf)


def linear(seed: int) -> tuple[np.ndarray, np.ndarray, Statistics]:
    """Columns [n, 7, P], what is missed at numbers 0, [n, 7], and the statistics there."""
    rng = np.random.default_rng(seed)
    columns, missed = rng.normal(size=(30, 7, NUMBERS)), rng.normal(size=(30, 7))
    curvature, slope = np.einsum("nxp,nxq->npq", columns, columns), np.einsum("nxp,nx->np", columns, missed)
    return columns, missed, Statistics(curvature, slope, np.square(missed).sum(1))


def test_undamped_step_reaches_the_minimum_and_predicted_decrease() -> None:
    columns, missed, statistics = linear(0)
    none, hold = np.zeros(NUMBERS), np.zeros((NUMBERS, NUMBERS))
    there = damped_step(none, none, statistics, damping=0.0, hold=hold, bounds=FREE)
    minimum = np.linalg.lstsq(columns.reshape(-1, NUMBERS), missed.ravel(), rcond=None)[0]
    np.testing.assert_allclose(there, minimum, atol=1e-6)
    fall = (np.square(missed) - np.square(missed - columns @ there)).sum(1).mean()
    assert predicted_decrease(there, none, statistics, hold) == pytest.approx(fall, rel=1e-6)


def test_prior_pulls_parameters_to_their_start() -> None:
    _, _, statistics = linear(1)
    hold = 1e6 * np.eye(NUMBERS)
    away = np.arange(NUMBERS, dtype=float)
    np.testing.assert_allclose(
        damped_step(away + 2.0, away, statistics, damping=0.0, hold=hold, bounds=FREE), 2.0, atol=1e-3
    )


def test_damping_shortens_the_step() -> None:
    _, _, statistics = linear(2)
    none, hold = np.zeros(NUMBERS), np.zeros((NUMBERS, NUMBERS))
    lengths = [
        np.linalg.norm(damped_step(none, none, statistics, damping=d, hold=hold, bounds=FREE)) for d in (0.0, 0.1, 10.0)
    ]
    assert lengths[0] > lengths[1] > 5 * lengths[2] > 0


def test_bounded_step_equals_a_bounded_solver() -> None:
    columns, missed, statistics = linear(3)
    none, hold = np.zeros(NUMBERS), np.zeros((NUMBERS, NUMBERS))
    free = damped_step(none, none, statistics, damping=0.0, hold=hold, bounds=FREE)
    low, high = bounds = np.full(NUMBERS, -10.0), np.full(NUMBERS, 10.0)
    low[np.argmin(free)], high[np.argmax(free)] = 0.5 * free.min(), 0.5 * free.max()
    expected = lsq_linear(columns.reshape(-1, NUMBERS), missed.ravel(), bounds).x
    np.testing.assert_allclose(
        damped_step(none, none, statistics, damping=0.0, hold=hold, bounds=bounds), expected, atol=1e-4
    )
