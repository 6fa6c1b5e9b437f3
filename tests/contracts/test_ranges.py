"""Ranges are said as sentences, and NaN is in none."""

from types import SimpleNamespace

import pytest

from pentimento.contracts.ranges import above_zero, at_least


def test_range_check_accepts_numbers_in_range() -> None:
    at_least(SimpleNamespace(strokes=1, seed=0), 0, "strokes", "seed")
    above_zero(SimpleNamespace(edge_m=1e-9), "edge_m")


@pytest.mark.parametrize("value", [0, -5, float("nan")])
def test_range_check_names_the_field_out_of_range(value: float) -> None:
    with pytest.raises(ValueError, match=rf"^strokes is {value}; it must be 1 or more\.$"):
        at_least(SimpleNamespace(batch=1, strokes=value), 1, "batch", "strokes")
    with pytest.raises(ValueError, match=rf"^strokes is {value}; it must be above 0\.$"):
        above_zero(SimpleNamespace(strokes=value), "strokes")
