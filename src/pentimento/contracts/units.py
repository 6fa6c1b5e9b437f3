"""Quantities with units ("12 mm") are parsed at the interface; inside there are only SI floats.

`parse_quantity` takes text from a parameter or tool file and returns a float in the SI unit that the caller names, so
that a wrong dimension is an error.
"""

import math
import re
from typing import Final

from pentimento.contracts.errors import UnitError

_LENGTH: Final = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
_TIME: Final = {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0}
_ANGLE: Final = {"rad": 1.0, "deg": math.pi / 180.0}
_FORCE: Final = {"N": 1.0, "mN": 1e-3}
_SCALE: Final = {"px/m": 1.0, "px/cm": 1e2, "px/mm": 1e3, "dpi": 1.0 / 0.0254}


def _table() -> dict[str, tuple[str, float]]:
    """unit -> (dimension, factor to SI)."""
    table: dict[str, tuple[str, float]] = {}
    for dimension, units in (
        ("length", _LENGTH),
        ("time", _TIME),
        ("angle", _ANGLE),
        ("force", _FORCE),
        ("pixels per length", _SCALE),
    ):
        table.update({name: (dimension, factor) for name, factor in units.items()})
    for dimension, units in (("length", _LENGTH), ("angle", _ANGLE)):
        for name, factor in units.items():
            table[f"{name}/s"] = (f"{dimension} per time", factor)
            table[f"{name}/s^2"] = (f"{dimension} per time squared", factor)
    return table


_UNITS: Final = _table()
_QUANTITY: Final = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-z][A-Za-z/^0-9]*)?\s*")


def parse_quantity(text: str, unit: str) -> float:
    """The number of `unit`s in `text`: `parse_quantity("12 mm", "m") == 0.012`.

    Args:
        text: a number, an optional space, and a unit, e.g. "30 deg" or "0.1 m/s".
        unit: the unit of the result, e.g. "m", "s", "rad", "m/s", "m/s^2", "N", "px/m".

    Raises:
        UnitError: no number, no unit, an unknown unit, or a unit of another dimension.
    """
    if unit not in _UNITS:
        raise UnitError(f"Unit {unit!r} is unknown; known units are {', '.join(sorted(_UNITS))}.")
    if not isinstance(text, str):
        raise UnitError(f"{text!r} is not text; write the quantity with its unit, such as '12 {unit}'.")
    match = _QUANTITY.fullmatch(text)
    if match is None:
        raise UnitError(f"{text!r} is not a quantity; write a number and a unit, such as '12 {unit}'.")
    number, name = match.groups()
    if name is None:
        raise UnitError(f"{text!r} has no unit; write it, such as '{number} {unit}'.")
    if name not in _UNITS:
        raise UnitError(f"{text!r} has the unknown unit {name!r}; use one such as {unit!r}.")
    dimension, factor = _UNITS[name]
    wanted_dimension, wanted_factor = _UNITS[unit]
    if dimension != wanted_dimension:
        raise UnitError(f"{text!r} is a {dimension}, but a {wanted_dimension} is needed, such as '1 {unit}'.")
    value = float(number) * factor / wanted_factor
    if not math.isfinite(value):
        raise UnitError(f"{text!r} is too large to be represented; check its exponent.")
    return value
