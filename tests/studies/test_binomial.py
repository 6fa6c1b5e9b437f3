"""Exact intervals and tests of a share."""

import pytest

from studies.blind.binomial import Bar, falls_short, interval, standing


@pytest.mark.parametrize("of", [1, 10, 150])
def test_interval_of_none_and_of_all_has_its_closed_form(of: int) -> None:
    edge = 0.025 ** (1 / of)  # p with p^n = 2.5 %
    assert interval(of, of) == pytest.approx((edge, 1.0))
    assert interval(0, of) == pytest.approx((0.0, 1 - edge))


def test_interval_holds_the_share_and_narrows_with_more_worlds() -> None:
    (low, high), (lower, higher) = interval(80, 100), interval(8, 10)
    assert lower < low < 0.8 < high < higher
    assert interval(0, 0) == (0.0, 1.0)


def test_a_bar_that_is_just_missed_is_not_missed_for_certain() -> None:
    assert not falls_short(94, 100, Bar("at least", 0.95))
    assert falls_short(88, 100, Bar("at least", 0.95))
    assert not falls_short(5, 150, Bar("at most", 0.03))
    assert falls_short(12, 150, Bar("at most", 0.03))


def test_the_test_keeps_its_level() -> None:
    """p of all n or none is bar^n: the closed form says from where a bar is rejected."""
    n = 58  # 0.95^58 = 5.1 %, 0.95^59 = 4.8 %
    assert not falls_short(n, n, Bar("at most", 0.95)) and falls_short(n + 1, n + 1, Bar("at most", 0.95))
    assert not falls_short(0, n, Bar("at least", 0.05)) and falls_short(0, n + 1, Bar("at least", 0.05))


def test_nothing_counted_falls_short_of_nothing() -> None:
    assert not falls_short(0, 0, Bar("at least", 0.95))


def test_a_share_beyond_its_bar_is_undecided_until_it_is_certain() -> None:
    shares = [standing(hits, 100, Bar("at least", 0.95)) for hits in (96, 95, 94, 80)]
    assert shares == ["meets", "meets", "undecided", "falls short"]
    assert [standing(hits, 100, Bar("at most", 0.03)) for hits in (3, 4, 12)] == ["meets", "undecided", "falls short"]
