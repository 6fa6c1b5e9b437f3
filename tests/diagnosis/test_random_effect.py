"""What each row has of its own is told from what all have alike."""

from __future__ import annotations

import numpy as np
import pytest

from pentimento.diagnosis.boosting import action_effect

ROW = np.repeat(np.arange(6), 80)


def drawn() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How pixels change with three numbers of their row [n, 3], what is left beside that [n], weights [n]."""
    rng = np.random.default_rng(0)
    return rng.normal(size=(480, 3)), rng.normal(size=480), rng.uniform(0.5, 2.0, 480)


def test_another_amount_in_each_row_is_all_its_own() -> None:
    by, _, weight = drawn()
    amounts = np.random.default_rng(1).normal(size=(6, 3))
    values = (by * amounts[ROW]).sum(1)
    np.testing.assert_allclose(action_effect(values, by, weight, ROW), values, atol=1e-9)


def test_what_is_left_is_square_to_what_was_taken() -> None:
    by, values, weight = drawn()
    left = values - action_effect(values, by, weight, ROW)
    for row in range(6):
        of = row == ROW
        np.testing.assert_allclose(by[of].T @ (weight * left)[of], 0.0, atol=1e-9)


def test_a_row_that_shows_none_of_it_keeps_all() -> None:
    by, values, weight = drawn()
    by[ROW == 2] = 0.0
    taken = action_effect(values, by, weight, ROW)
    assert not taken[ROW == 2].any() and taken[ROW == 3].any()


def test_numbers_that_do_the_same_share_the_work() -> None:
    """A column that is there twice leaves the numbers open, and not what they do."""
    by, values, weight = drawn()
    twice = np.column_stack([by, by[:, 0]])
    assert action_effect(values, twice, weight, ROW) == pytest.approx(action_effect(values, by, weight, ROW), abs=1e-9)
