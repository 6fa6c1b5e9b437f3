"""What the robot knows about its tools (brushes and pens), end-effectors (what it presses into clay) and feeders (what
sets pellets on it).

A file holds what a person reads off the package or measures with a ruler, and the ranges that may be commanded. How the
tool really behaves is for the models to learn: the studio's world files, which hold it, are never read here.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.codec import find_toml, from_table, read_toml
from pentimento.contracts.errors import ConfigError

Medium = Literal["ink", "acrylic"]
ToolKind = Literal["marker", "round", "flat"]
PushKind = Literal["push", "pinch"]

_TOOLS: Final = Path(__file__).with_name("tools")
_END_EFFECTORS: Final = Path(__file__).with_name("end_effectors")
_FEEDERS: Final = Path(__file__).with_name("feeders")
_SAME_COLOUR: Final = 0.5 / 255  # half a step of 8-bit sRGB


@dataclass(frozen=True)
class Tool:
    """One brush or pen, in SI units. Ranges are (min, max)."""

    name: str
    medium: Medium
    kind: ToolKind
    nominal_width_m: float
    """Stroke width to expect before anything is learned."""
    press_range_m: tuple[float, float]
    stroke_length_m: tuple[float, float]
    bend_range: tuple[float, float]
    """Sideways excursion of a stroke's middle over its length; left of the heading is positive."""
    speed_m_s: float
    speed_range_m_s: tuple[float, float]
    strokes_per_dip: int
    """Strokes of one load where no depletion is diagnosed; 0 for a tool that is never dipped."""
    max_strokes_per_dip: int | None = None
    """Maximum with a diagnosed depletion, which decides below it; None for `strokes_per_dip`."""
    max_fade: float | None = None
    """Share of a fresh load's darkness that may be missing at a stroke's end (see `robots.refill`); None to dip by
    count alone."""
    color_srgb: tuple[float, float, float] | None = None
    """None where the colour comes from the palette."""

    @property
    def dips(self) -> bool:
        """Whether the tool takes its paint from a palette."""
        return self.strokes_per_dip > 0

    @property
    def most_strokes_per_dip(self) -> int:
        """The tool's limit of strokes of one load, however little it fades."""
        return self.strokes_per_dip if self.max_strokes_per_dip is None else self.max_strokes_per_dip


@dataclass(frozen=True)
class EndEffector:
    """One end-effector, in SI units. Ranges are (min, max)."""

    name: str
    kind: PushKind
    nominal_width_m: float
    """Width of the groove to expect before anything is learned."""
    opening_m: float
    """Distance between the middles of a gripper's two open fingers; 0 for a single tool."""
    travel_m: tuple[float, float]
    """Length of a push, or closing of a pinch."""
    depth_m: tuple[float, float]
    """Depth at the end of travel."""
    speed_m_s: float
    speed_range_m_s: tuple[float, float]
    retract_speed_range_m_s: tuple[float, float]
    dwell_range_s: tuple[float, float]


@dataclass(frozen=True)
class Feeder:
    """What sets pellets of the material on the clay and presses them, in SI units."""

    name: str
    diameter_m: tuple[float, float]
    """(min, max) of a pellet as a ball."""
    pressed_share: float
    """Height above the surface to which a pellet is pressed, as a share of its diameter."""

    @property
    def volume_m3(self) -> tuple[float, float]:
        """(min, max) of a pellet."""
        return ball_m3(self.diameter_m[0]), ball_m3(self.diameter_m[1])

    def press_m(self, volume_m3: float) -> float:
        """Height above the surface to which a pellet of this volume is pressed."""
        return self.pressed_share * ball_diameter_m(volume_m3)


def ball_m3(diameter_m: float) -> float:
    """Volume of a ball."""
    return float(np.pi / 6.0 * diameter_m**3)


def ball_diameter_m(volume_m3: float) -> float:
    """Diameter of a ball; the inverse of ``ball_m3``."""
    return float((6.0 * volume_m3 / np.pi) ** (1.0 / 3.0))


def load_tool(name_or_path: str | Path) -> Tool:
    """Read a tool by the name of a shipped file (`round_brush`) or by the path of a TOML file.

    Raises:
        ConfigError: an unknown name, an unreadable file, or an unknown, missing or bad key.
    """
    path, where = find_toml(name_or_path, _TOOLS, "tool"), f"Tool {name_or_path}"
    tool = from_table(Tool, read_toml(path, "tool"), where)
    _check(tool, where)
    for key, value in (("nominal_width", tool.nominal_width_m), ("stroke_length", tool.stroke_length_m[0])):
        if not value > 0:
            raise ConfigError(f"{where}: {key} must be above zero, it is {value} m.")
    if not 0 <= tool.press_range_m[0] < tool.press_range_m[1]:
        raise ConfigError(f"{where}: press_range {tool.press_range_m} m must rise from 0 or more.")
    if tool.strokes_per_dip < 0:
        raise ConfigError(f"{where}: strokes_per_dip is {tool.strokes_per_dip}; it is 0 (never) or more.")
    if tool.most_strokes_per_dip < tool.strokes_per_dip or (not tool.dips and tool.most_strokes_per_dip):
        raise ConfigError(
            f"{where}: max_strokes_per_dip is {tool.max_strokes_per_dip}; it is strokes_per_dip "
            f"({tool.strokes_per_dip}) or more, and left out for a tool that is never dipped."
        )
    if tool.max_fade is not None and not 0 < tool.max_fade < 1:
        raise ConfigError(f"{where}: max_fade is {tool.max_fade}; it is a share above 0 and below 1.")
    if not tool.dips and tool.color_srgb is None:
        raise ConfigError(f"{where}: a tool that never dips (strokes_per_dip = 0) needs color_srgb.")
    if tool.color_srgb is not None and not all(0 <= channel <= 1 for channel in tool.color_srgb):
        raise ConfigError(f"{where}: color_srgb is {list(tool.color_srgb)}; its three numbers run from 0 to 1.")
    return tool


def load_end_effector(name_or_path: str | Path) -> EndEffector:
    """Read an end-effector by the name of a shipped file (`ball`) or by the path of a TOML file.

    Raises:
        ConfigError: an unknown name, an unreadable file, or an unknown, missing or bad key.
    """
    path, where = find_toml(name_or_path, _END_EFFECTORS, "end-effector"), f"End-effector {name_or_path}"
    found = from_table(EndEffector, read_toml(path, "end-effector"), where)
    _check(found, where)
    minima = {"nominal_width": found.nominal_width_m, "retract_speed_range": found.retract_speed_range_m_s[0]}
    for key, value in minima.items():
        if not value > 0:
            raise ConfigError(f"{where}: {key} must be above zero, it is {value}.")
    for key, (low, high) in (("travel", found.travel_m), ("depth", found.depth_m)):
        if not 0 <= low < high:
            raise ConfigError(f"{where}: {key} [{low}, {high}] m must rise from 0 or more.")
    pinches = found.kind == "pinch"
    if pinches != (found.opening_m > 0) or not found.travel_m[1] * pinches <= found.opening_m:
        raise ConfigError(
            f"{where}: opening is {found.opening_m} m; it is 0 for a push, and at least the maximum travel for a pinch."
        )
    if found.dwell_range_s[0] < 0:
        raise ConfigError(f"{where}: dwell_range begins at {found.dwell_range_s[0]} s; a dwell lasts 0 s or longer.")
    return found


def load_feeder(name_or_path: str | Path) -> Feeder:
    """Read a feeder by the name of a shipped file (`pellets`) or by the path of a TOML file.

    Raises:
        ConfigError: an unknown name, an unreadable file, or an unknown, missing or bad key.
    """
    path, where = find_toml(name_or_path, _FEEDERS, "feeder"), f"Feeder {name_or_path}"
    feeder = from_table(Feeder, read_toml(path, "feeder"), where)
    if not feeder.name:
        raise ConfigError(f"{where}: name must be a non-empty text.")
    if not 0 < feeder.diameter_m[0] < feeder.diameter_m[1]:
        raise ConfigError(f"{where}: diameter {list(feeder.diameter_m)} m must rise from above 0.")
    if not 0 < feeder.pressed_share <= 1:
        raise ConfigError(f"{where}: pressed_share is {feeder.pressed_share}; it is a share above 0, at most 1.")
    return feeder


def _check(found: Tool | EndEffector, where: str) -> None:
    """What tools and end-effectors have in common: a name, rising ranges, a speed within its range."""
    if not found.name:
        raise ConfigError(f"{where}: name must be a non-empty text.")
    ranges: dict[str, Any] = {key: value for key, value in vars(found).items() if _is_range(value)}
    for key, (low, high) in ranges.items():
        if low > high:
            raise ConfigError(f"{where}: {key} runs from {low} down to {high}; put the minimum first.")
    low, high = found.speed_range_m_s
    if not 0 < low <= found.speed_m_s <= high:
        raise ConfigError(
            f"{where}: speed {found.speed_m_s} m/s must lie within speed_range [{low}, {high}] m/s, above zero."
        )


def _is_range(value: object) -> bool:
    return isinstance(value, tuple) and len(value) == 2


def same_colour(one_srgb: NDArray[np.float64], other_srgb: NDArray[np.float64]) -> bool:
    """Whether two colours [3] are one 8-bit colour; never true of NaN."""
    return bool(np.all(np.abs(np.asarray(one_srgb) - np.asarray(other_srgb)) <= _SAME_COLOUR))
