"""Means over seeds with Student's t intervals."""

import math

import numpy as np
import pytest
from scipy.stats import sem, t

from studies.student_t import mean_interval


@pytest.mark.parametrize("count", [2, 3, 5, 20])
def test_interval_is_that_of_scipy(count: int) -> None:
    values = np.random.default_rng(count).normal(2.0, 0.5, count)
    found = mean_interval(values.tolist())
    low, high = t.interval(0.95, count - 1, loc=values.mean(), scale=sem(values))
    assert (found.value, found.low, found.high) == pytest.approx((values.mean(), low, high))


def test_one_value_has_no_interval() -> None:
    found = mean_interval([3.0])
    assert found.value == 3.0
    assert math.isnan(found.low)
    assert math.isnan(found.high)
