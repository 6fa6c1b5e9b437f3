"""The random effect of each action in pixel values."""

from __future__ import annotations

import numpy as np
import pytest

from pentimento.diagnosis.boosting import action_effect

ROW = np.repeat(np.arange(6), 80)


def drawn() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How pixels change with three numbers of their row [n, 3], what is left beside that [n], weights [n]."""
    rng = np.random.default_rng(0)
    return rng.normal(size=(480, 3)), rng.normal(size=480), rng.uniform(0.5, 2.0, 480)


def test_action_effect_takes_all_of_a_row_specific_amount() -> None:
    by, _, weight = drawn()
    amounts = np.random.default_rng(1).normal(size=(6, 3))
    values = (by * amounts[ROW]).sum(1)
    np.testing.assert_allclose(action_effect(values, by, weight, ROW), values, atol=1e-9)


def test_remainder_is_orthogonal_to_the_action_effect() -> None:
    by, values, weight = drawn()
    left = values - action_effect(values, by, weight, ROW)
    for row in range(6):
        of = row == ROW
        np.testing.assert_allclose(by[of].T @ (weight * left)[of], 0.0, atol=1e-9)


def test_row_without_sensitivity_has_no_action_effect() -> None:
    by, values, weight = drawn()
    by[ROW == 2] = 0.0
    taken = action_effect(values, by, weight, ROW)
    assert not taken[ROW == 2].any() and taken[ROW == 3].any()


def test_action_effect_handles_collinear_regressors() -> None:
    """A column that is there twice leaves the numbers open, and not what they do."""
    by, values, weight = drawn()
    twice = np.column_stack([by, by[:, 0]])
    assert action_effect(values, twice, weight, ROW) == pytest.approx(action_effect(values, by, weight, ROW), abs=1e-9)
