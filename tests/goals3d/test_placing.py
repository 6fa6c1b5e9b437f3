"""Placing keeps proportions and the middle; softening keeps volume."""

import numpy as np
import pytest

from pentimento.goals3d.placing import place, soften
from pentimento.planning.pushes.goal import GoalError


def test_a_wide_relief_stands_in_the_middle_in_its_proportions() -> None:
    bar = np.zeros((10, 40))
    bar[1:-1, 1:-1] = 1.0
    placed = place(bar, (64, 64), 0.625)
    rows, columns = np.nonzero(placed > 0.5)
    assert (rows.min() + rows.max()) / 2 == pytest.approx(31.5, abs=0.5)
    assert (columns.min() + columns.max()) / 2 == pytest.approx(31.5, abs=0.5)
    assert np.ptp(columns) / np.ptp(rows) == pytest.approx(37 / 7, rel=0.02)


def test_around_it_its_rim_goes_on() -> None:
    plate = np.full((8, 8), 5.0)
    plate[3:5, 3:5] = 0.0
    assert set(np.unique(place(plate, (32, 32), 0.5)[:7])) == {5.0}


@pytest.mark.parametrize("share", [0.0, 1.5, float("nan")])
def test_shares_that_mean_nothing_are_sentences(share: float) -> None:
    with pytest.raises(GoalError, match="of the area"):
        place(np.zeros((4, 4)), (8, 8), share)


def test_holes_and_lines_are_sentences() -> None:
    with pytest.raises(GoalError, match="1 holes"):
        place(np.array([[0.0, np.nan], [0, 0]]), (8, 8), 1.0)
    with pytest.raises(GoalError, match="at least 2 x 2"):
        place(np.zeros((1, 5)), (8, 8), 1.0)


def test_softening_keeps_volume_and_lowers_slopes() -> None:
    step = np.zeros((40, 40))
    step[10:30, 10:30] = 1.0
    soft = soften(step, 2.0)
    assert soft.sum() == pytest.approx(step.sum(), rel=1e-6)
    assert np.abs(np.diff(soft)).max() < 0.3
    np.testing.assert_array_equal(soften(step, 0.0), step)
