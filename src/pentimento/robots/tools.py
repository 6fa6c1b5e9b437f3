"""What the robot is told about the tool in its gripper.

A tool file holds what a person reads off the package or measures with a ruler. How the tool really
behaves is for the models to learn; the studio's world files, which know it, are never read here.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Literal

from pentimento.contracts.errors import ConfigError, UnitError
from pentimento.contracts.units import parse_quantity

Medium = Literal["ink", "acrylic"]
Kind = Literal["marker", "round", "flat"]

_REQUIRED = frozenset(
    {
        "name",
        "medium",
        "kind",
        "nominal_width",
        "press_range",
        "stroke_length",
        "bend_range",
        "speed",
        "speed_range",
        "strokes_per_dip",
    }
)
_OPTIONAL = frozenset({"color_srgb"})


@dataclass(frozen=True)
class Tool:
    """One tool, in SI units.

    `bend_range` is the sideways excursion of a stroke's middle as a share of its length (signed, left
    positive). `strokes_per_dip` is 0 for a tool that never dips. `color_srgb` is None where the colour
    comes from the palette. `nominal_width_m` is the stroke width to expect before anything is learned.
    """

    name: str
    medium: Medium
    kind: Kind
    nominal_width_m: float
    press_range_m: tuple[float, float]
    stroke_length_m: tuple[float, float]
    bend_range: tuple[float, float]
    speed_m_s: float
    speed_range_m_s: tuple[float, float]
    strokes_per_dip: int
    color_srgb: tuple[float, float, float] | None = None

    @property
    def dips(self) -> bool:
        """Whether the tool takes its paint from a palette."""
        return self.strokes_per_dip > 0


def load_tool(name_or_path: str | Path) -> Tool:
    """Read a tool by the name of a bundled file (`round_brush`) or by the path of a TOML file.

    Raises ConfigError for an unknown name, an unreadable file, and an unknown, missing or bad key.
    """
    path = Path(name_or_path)
    if path.suffix == ".toml":
        if not path.is_file():
            raise ConfigError(f"The tool file {path} does not exist; give a .toml file or one of {_bundled()}.")
        text = path.read_bytes()
    elif str(name_or_path) in _bundled():
        text = (_folder() / f"{name_or_path}.toml").read_bytes()
    else:
        raise ConfigError(
            f"There is no tool named {str(name_or_path)!r}; choose one of {_bundled()} "
            "or give the path of a .toml file."
        )
    try:
        table = tomllib.loads(text.decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ConfigError(f"The tool file {name_or_path} is not valid TOML: {error}.") from error
    return _parse(table, str(name_or_path))


def _folder() -> Any:
    return resources.files("pentimento.robots") / "tools"


def _bundled() -> list[str]:
    names = [entry.name for entry in _folder().iterdir()]
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml"))


def _parse(table: Mapping[str, Any], source: str) -> Tool:
    missing, unknown = _REQUIRED - table.keys(), table.keys() - _REQUIRED - _OPTIONAL
    if missing or unknown:
        raise ConfigError(
            f"Tool {source}: missing keys {sorted(missing)}, unknown keys {sorted(unknown)}; "
            f"a tool has {sorted(_REQUIRED)} and may have {sorted(_OPTIONAL)}."
        )
    tool = Tool(
        name=_choice(table, "name", None, source),
        medium=_choice(table, "medium", ("ink", "acrylic"), source),
        kind=_choice(table, "kind", ("marker", "round", "flat"), source),
        nominal_width_m=_quantity(table["nominal_width"], "nominal_width", "m", source),
        press_range_m=_range(table, "press_range", "m", source),
        stroke_length_m=_range(table, "stroke_length", "m", source),
        bend_range=_range(table, "bend_range", None, source),
        speed_m_s=_quantity(table["speed"], "speed", "m/s", source),
        speed_range_m_s=_range(table, "speed_range", "m/s", source),
        strokes_per_dip=_count(table["strokes_per_dip"], source),
        color_srgb=_color(table["color_srgb"], source) if "color_srgb" in table else None,
    )
    _check(tool, source)
    return tool


def _check(tool: Tool, source: str) -> None:
    low, high = tool.speed_range_m_s
    if not 0 < low <= tool.speed_m_s <= high:
        raise ConfigError(
            f"Tool {source}: speed {tool.speed_m_s} m/s must lie within speed_range [{low}, {high}] m/s, above zero."
        )
    for key, value in (("nominal_width", tool.nominal_width_m), ("stroke_length", tool.stroke_length_m[0])):
        if not value > 0:
            raise ConfigError(f"Tool {source}: {key} must be above zero, it is {value} m.")
    if not 0 <= tool.press_range_m[0] < tool.press_range_m[1]:
        raise ConfigError(f"Tool {source}: press_range {tool.press_range_m} m must rise from 0 or more.")
    if not tool.dips and tool.color_srgb is None:
        raise ConfigError(f"Tool {source}: a tool that never dips (strokes_per_dip = 0) needs color_srgb.")


def _choice(table: Mapping[str, Any], key: str, allowed: tuple[str, ...] | None, source: str) -> Any:
    value = table[key]
    if not isinstance(value, str) or not value or (allowed is not None and value not in allowed):
        raise ConfigError(
            f"Tool {source}: {key} is {value!r}; it must be "
            + (f"one of {list(allowed)}." if allowed else "a non-empty string.")
        )
    return value


def _quantity(value: Any, key: str, unit: str | None, source: str) -> float:
    if unit is None:
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise ConfigError(f"Tool {source}: {key} has {value!r} where a finite number is expected.")
        return float(value)
    if not isinstance(value, str):
        raise ConfigError(f'Tool {source}: {key} has {value!r}; write it with its unit, such as "2 mm".')
    try:
        return parse_quantity(value, unit)
    except UnitError as error:
        raise ConfigError(f"Tool {source}: {key}: {error}") from error


def _range(table: Mapping[str, Any], key: str, unit: str | None, source: str) -> tuple[float, float]:
    value = table[key]
    if not isinstance(value, list) or len(value) != 2:
        raise ConfigError(f"Tool {source}: {key} is {value!r}; give a list of a least and a greatest value.")
    low, high = (_quantity(item, key, unit, source) for item in value)
    if low > high:
        raise ConfigError(f"Tool {source}: {key} runs from {low} down to {high}; put the least value first.")
    return low, high


def _count(value: Any, source: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise ConfigError(f"Tool {source}: strokes_per_dip is {value!r}; it must be a whole number, 0 for never.")
    return value


def _color(value: Any, source: str) -> tuple[float, float, float]:
    if not isinstance(value, list) or len(value) != 3:
        raise ConfigError(f"Tool {source}: color_srgb is {value!r}; it must be three numbers from 0 to 1.")
    red, green, blue = (_quantity(item, "color_srgb", None, source) for item in value)
    if not all(0 <= channel <= 1 for channel in (red, green, blue)):
        raise ConfigError(f"Tool {source}: color_srgb is {value!r}; its three numbers run from 0 to 1.")
    return red, green, blue
