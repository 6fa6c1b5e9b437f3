"""What the study of spoken manners computes, in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from studies.spoken_manner import in_order, level_db, rank_correlation


def test_order_of_different_wishes_counts_equal_ones_as_half() -> None:
    assert in_order([0.0, 0.0, 0.0], [1.0, 1.0, 1.0]) == 1.0
    assert in_order([0.0, 0.0], [0.0, 0.0]) == 0.5
    assert in_order([2.0, 0.0], [1.0, 3.0]) == 0.5 * (1.0 + 1.0)  # (2, 3) and (0, 1): the same wish does not count
    assert in_order([0.3, 0.1], [0.2, 0.4]) + in_order([0.2, 0.4], [0.3, 0.1]) == 1.0


def test_three_levels_in_perfect_order_have_the_highest_correlation_that_ties_allow() -> None:
    levels = np.repeat([0, 1, 2], 200)
    found = rank_correlation(levels.tolist(), np.arange(600.0).tolist())
    assert found == pytest.approx(math.sqrt(8 / 9), abs=1e-3)
    assert rank_correlation([0, 1, 2, 2], [1.0, 2.0, 3.0, math.nan]) == 1.0


def test_level_of_speech_does_not_depend_on_its_pauses() -> None:
    speech = 0.1 * np.sign(np.random.default_rng(0).normal(size=1000)).astype(np.float32)
    assert level_db(speech) == pytest.approx(-20.0, abs=1e-4) == level_db(np.pad(speech, 5000))
