"""What the robot is told about the end-effector in its hand.

An end-effector file holds what a person measures with a ruler and dares to command. How the material answers it
is for the models to learn; the studio's world files, which know it, are never read here.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Literal

from pentimento.contracts.errors import ConfigError, UnitError
from pentimento.contracts.units import parse_quantity

Kind = Literal["push", "pinch"]

_UNITS = {
    "nominal_width": "m",
    "opening": "m",
    "travel": "m",
    "depth": "m",
    "speed": "m/s",
    "speed_range": "m/s",
    "retract_speed_range": "m/s",
    "dwell_range": "s",
}
_RANGES = frozenset({"travel", "depth", "speed_range", "retract_speed_range", "dwell_range"})


@dataclass(frozen=True)
class EndEffector:
    """One end-effector, in SI units.

    `travel_m` is the least and the greatest length of a push, or closing of a pinch; `depth_m` that of its depth
    at the end; `nominal_width_m` the width of the groove to expect before anything is learned;
    `opening_m` how far apart the middles of a gripper's two open fingers are, 0 for a single tool.
    """

    name: str
    kind: Kind
    nominal_width_m: float
    opening_m: float
    travel_m: tuple[float, float]
    depth_m: tuple[float, float]
    speed_m_s: float
    speed_range_m_s: tuple[float, float]
    retract_speed_range_m_s: tuple[float, float]
    dwell_range_s: tuple[float, float]


def load_end_effector(name_or_path: str | Path) -> EndEffector:
    """Read an end-effector by the name of a bundled file (`ball`) or by the path of a TOML file.

    Raises ConfigError for an unknown name, an unreadable file, and an unknown, missing or bad key.
    """
    path = Path(name_or_path)
    if path.suffix == ".toml":
        if not path.is_file():
            raise ConfigError(f"The end-effector file {path} does not exist; give a .toml file or one of {bundled()}.")
        text = path.read_bytes()
    elif str(name_or_path) in bundled():
        text = (_folder() / f"{name_or_path}.toml").read_bytes()
    else:
        raise ConfigError(
            f"There is no end-effector named {str(name_or_path)!r}; choose one of {bundled()} "
            "or give the path of a .toml file."
        )
    try:
        table = tomllib.loads(text.decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ConfigError(f"The end-effector file {name_or_path} is not valid TOML: {error}.") from error
    return _parse(table, f"End-effector {name_or_path}")


def bundled() -> list[str]:
    """Names of the end-effectors that come with the package."""
    names = [entry.name for entry in _folder().iterdir()]
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml"))


def _folder() -> Any:
    return resources.files("pentimento.robots") / "end_effectors"


def _parse(table: Mapping[str, Any], where: str) -> EndEffector:
    expected = {"name", "kind", *_UNITS}
    missing, unknown = expected - table.keys(), table.keys() - expected
    if missing or unknown:
        raise ConfigError(
            f"{where}: missing keys {sorted(missing)}, unknown keys {sorted(unknown)}; it has {sorted(expected)}."
        )
    if not isinstance(table["name"], str) or not table["name"]:
        raise ConfigError(f"{where}: name is {table['name']!r}; it must be a non-empty string.")
    if table["kind"] not in ("push", "pinch"):
        raise ConfigError(f"{where}: kind is {table['kind']!r}; it must be push or pinch.")
    values: dict[str, Any] = {
        f"{key}_{unit.replace('/', '_')}": (_range if key in _RANGES else _quantity)(table[key], key, unit, where)
        for key, unit in _UNITS.items()
    }
    made = EndEffector(name=table["name"], kind=table["kind"], **values)
    _check(made, where)
    return made


def _check(made: EndEffector, where: str) -> None:
    low, high = made.speed_range_m_s
    if not 0 < low <= made.speed_m_s <= high:
        raise ConfigError(
            f"{where}: speed {made.speed_m_s} m/s must lie within speed_range [{low}, {high}] m/s, above zero."
        )
    for key, minimum in (
        ("nominal_width", made.nominal_width_m),
        ("retract_speed_range", made.retract_speed_range_m_s[0]),
    ):
        if not minimum > 0:
            raise ConfigError(f"{where}: {key} must be above zero, it is {minimum}.")
    for key, (minimum, most) in (("travel", made.travel_m), ("depth", made.depth_m)):
        if not 0 <= minimum < most:
            raise ConfigError(f"{where}: {key} [{minimum}, {most}] m must rise from 0 or more.")
    if (made.kind == "pinch") != (made.opening_m > 0) or not made.travel_m[1] * (
        made.kind == "pinch"
    ) <= made.opening_m:
        raise ConfigError(
            f"{where}: opening is {made.opening_m} m; it is 0 for a push, and at least the greatest travel for a pinch."
        )
    if made.dwell_range_s[0] < 0:
        raise ConfigError(f"{where}: dwell_range begins at {made.dwell_range_s[0]} s; a rest lasts 0 s or longer.")


def _quantity(value: Any, key: str, unit: str, where: str) -> float:
    if not isinstance(value, str):
        raise ConfigError(f'{where}: {key} has {value!r}; write it with its unit, such as "2 mm".')
    try:
        return parse_quantity(value, unit)
    except UnitError as error:
        raise ConfigError(f"{where}: {key}: {error}") from error


def _range(value: Any, key: str, unit: str, where: str) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != 2:
        raise ConfigError(f"{where}: {key} is {value!r}; give a list of a least and a greatest value.")
    low, high = (_quantity(item, key, unit, where) for item in value)
    if low > high:
        raise ConfigError(f"{where}: {key} runs from {low} down to {high}; put the least value first.")
    return low, high
