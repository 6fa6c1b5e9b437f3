import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pentimento.contracts.errors import UnitError
from pentimento.contracts.units import parse_quantity


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("12 mm", "m", 0.012),
        ("12mm", "m", 0.012),
        ("30 deg", "rad", math.pi / 6),
        ("0.1 m/s", "m/s", 0.1),
        ("100 mm/s", "m/s", 0.1),
        ("2 m/s^2", "mm/s^2", 2000.0),
        ("1 in", "mm", 25.4),
        ("-1.5e-3 m", "mm", -1.5),
        ("90 deg/s", "rad/s", math.pi / 2),
        ("1.5 min", "s", 90.0),
        ("4 px/mm", "px/m", 4000.0),
        ("254 dpi", "px/mm", 10.0),
    ],
)
def test_known_conversions(text: str, unit: str, value: float) -> None:
    assert parse_quantity(text, unit) == pytest.approx(value, rel=1e-12)


@given(st.floats(-1e6, 1e6), st.sampled_from(["mm", "cm", "in", "m"]))
def test_there_and_back(value: float, unit: str) -> None:
    metres = parse_quantity(f"{value!r} {unit}", "m")
    assert parse_quantity(f"{metres!r} m", unit) == pytest.approx(value, rel=1e-12, abs=1e-300)


@pytest.mark.parametrize(
    ("text", "unit", "says"),
    [
        ("12", "m", "no unit"),
        ("12 mm", "s", "is a length, but a time"),
        ("12 parsec", "m", "unknown unit 'parsec'"),
        ("twelve mm", "m", "not a quantity"),
        ("nan m", "m", "not a quantity"),
        ("1e999 m", "m", "too large"),
        ("1 m", "furlong", "'furlong' is unknown"),
        ("1 mm/s", "m", "length per time"),
        ("", "m", "not a quantity"),
    ],
)
def test_bad_quantity_raises_unit_error_with_a_message(text: str, unit: str, says: str) -> None:
    with pytest.raises(UnitError, match=says):
        parse_quantity(text, unit)


def test_a_bare_number_is_refused_because_its_unit_is_not_known() -> None:
    with pytest.raises(UnitError, match="write the quantity with its unit"):
        parse_quantity(12, "m")  # type: ignore[arg-type]
