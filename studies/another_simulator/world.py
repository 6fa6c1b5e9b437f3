"""What a world of the second simulator is: a tool, its arm's and its paint's faults, a camera."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal

ToolKind = Literal["nib", "chisel", "hairs"]

CANVAS_M = (0.30, 0.22)
MIDDLE_M = (0.15, 0.11)
_BY_SPEED = frozenset({"latency", "speed_width", "speed_density"})


@dataclass(frozen=True)
class Effects:
    """How strong each fault is; 0: there is none. Each is named as the diagnosis should name it."""

    path_scale: float = 0.0
    """Share by which paths are too long about their start, four fifths of that along y."""
    path_offset: float = 0.0
    """Metres to the right, and three fifths of it down."""
    backlash: float = 0.0
    """Play of each axis, metres."""
    latency: float = 0.0
    """Seconds by which the place, not the press, comes late; the end is not reached."""
    bristle_lag: float = 0.0
    """Length of an inextensible leash behind the tip, metres."""
    canvas_tilt: float = 0.0
    """Metres of press from the middle to 0.1 m to the right, and as much to 0.1 m up."""
    lens_distortion: float = 0.0
    """Share of the distance from the middle that is added 0.1 m away from it."""
    speed_width: float = 0.0
    """Exponent of speed by which widths fall."""
    speed_density: float = 0.0
    """By how much paint thins at the usual speed: hyperbolic."""
    curvature_width: float = 0.0
    """Relative widening where the radius of the bend is 10 mm."""
    ink_depletion: float = 0.0
    """Inverse of the length after which half of the paint is left, 1/m."""
    tool_wear: float = 0.0
    """Relative widening at the end of the session; as the root of the length drawn."""
    drying_shift: float = 0.0
    """Share by which paint is paler at the end of the session."""
    paper_bleed: float = 0.0
    """Relative widening in damp air."""

    @property
    def causes(self) -> frozenset[str]:
        """Those that are there."""
        return frozenset(field.name for field in fields(self) if getattr(self, field.name))


@dataclass(frozen=True)
class World:
    """One world; what is not said here follows from its seed."""

    name: str
    tool: ToolKind
    seed: int
    effects: Effects = Effects()
    rows: int = 168
    repeats: bool = True
    """Whether 24 actions are there three times."""
    pixels_per_m: float = 1100.0
    color_srgb: tuple[float, float, float] = (0.10, 0.10, 0.12)
    painted_over: bool = False
    """Whether some strokes cross older, pale ones, of unknown age."""
    mixed_in: Literal["light", "numbers"] = "light"
    """Whether paint covers what is below in linear light, or in the picture's sRGB numbers, as drawing programs do."""
    sessions: int = 1
    mixes: tuple[float, ...] = (1.0,)
    """Share of the paint that is in each session's mix, in turn."""
    timed: bool = True
    """Whether the times of the points of a path were recorded."""

    @property
    def truth(self) -> frozenset[str]:
        """What the diagnosis should name: a broad edge is a cause, because no table names its tool; what goes with
        speed is none where no times were recorded.
        """
        hidden = frozenset() if self.timed else _BY_SPEED
        return self.effects.causes - hidden | ({"orientation_width"} if self.tool == "chisel" else frozenset())
