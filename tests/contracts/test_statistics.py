"""Bootstrap intervals against closed forms."""

import numpy as np
import pytest

from pentimento.contracts.statistics import (
    difference,
    gap_closed,
    interval,
    item_resamples,
    mean_estimate,
    ratio,
    resamples,
)


def test_interval_of_a_mean_is_as_wide_as_its_standard_error_predicts() -> None:
    values = np.random.default_rng(0).normal(3.0, 2.0, 400)
    found = mean_estimate(values, resamples(400, 4000, [0]))
    assert found is not None and found.value == pytest.approx(values.mean())
    half = 1.96 * values.std() / np.sqrt(400)
    assert found.high - found.value == pytest.approx(half, rel=0.1)
    assert found.value - found.low == pytest.approx(half, rel=0.1)


def test_interval_runs_from_the_2_5th_to_the_97_5th_percentile() -> None:
    assert interval(np.arange(1001.0)) == (25.0, 975.0)


def test_item_resamples_depend_on_count_and_seed_only() -> None:
    assert item_resamples(5, 3).shape == (2000, 5)
    np.testing.assert_array_equal(item_resamples(5, 3), item_resamples(5, 3))
    assert (item_resamples(5, 3) != item_resamples(5, 4)).any()


def test_mean_ignores_nan_and_is_none_without_any_value() -> None:
    drawn = resamples(4, 50, [0])
    found = mean_estimate(np.array([1.0, np.nan, 1.0, 1.0]), drawn)
    assert found is not None and (found.value, found.low, found.high) == (1.0, 1.0, 1.0)
    assert mean_estimate(np.full(4, np.nan), drawn) is None


def test_gap_closed_is_1_at_the_oracle_0_at_the_base_and_linear_between() -> None:
    generator, drawn = np.random.default_rng(1), resamples(60, 500, [2])
    base, oracle = generator.uniform(0.5, 1.0, 60), generator.uniform(0.0, 0.1, 60)
    for share in (0.0, 0.25, 1.0):
        found = gap_closed(base, base + share * (oracle - base), oracle, drawn)
        assert found is not None
        assert (found.value, found.low, found.high) == pytest.approx((share, share, share))
    assert gap_closed(oracle, base, base, drawn) is None  # nothing could be reached


def test_pairing_makes_a_constant_difference_and_ratio_exact() -> None:
    one, drawn = np.random.default_rng(2).normal(size=30), resamples(30, 200, [3])
    found = difference(one + 0.5, one, drawn)
    assert found is not None and found.high - found.low < 1e-12 and found.value == pytest.approx(0.5)
    three = ratio(np.full(30, 6.0), np.full(30, 2.0), drawn)
    assert three is not None and (three.value, three.low, three.high) == (3.0, 3.0, 3.0)
    assert ratio(one, np.zeros(30), drawn) is None
