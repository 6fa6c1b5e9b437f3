"""The interfaces that every robot serves, virtual or real: one for painting, one for sculpting."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import PentimentoError
from pentimento.contracts.observations import Photo, Scan
from pentimento.robots.tools import EndEffector, PushKind, Tool

FloatArray = NDArray[np.float64]


class MissingAbilityError(PentimentoError):
    """The robot lacks the device for a request."""


class Robot(Protocol):
    """A robot that paints on one canvas.

    All paths are float64[N, 5] in the canvas frame (t_s from 0, x_m, y_m, z_m, yaw_rad), at rest at both
    ends. The driver decides how the tip travels between strokes. Callers use a robot through
    `control.guard.GuardedRobot`, so that every command is checked.
    """

    @property
    def canvas_size_m(self) -> tuple[float, float]:
        """Width and height of the canvas."""
        ...

    @property
    def clock_s(self) -> float:
        """Seconds on the robot's own clock; every photo carries a time of the same clock."""
        ...

    def change_tool(self, tool: Tool) -> None:
        """Take `tool`; nothing happens where it is already held."""
        ...

    def load_palette(self, colors_srgb: FloatArray) -> None:
        """Lay out paints of these masstones, float[K, 3]; nothing happens where they already lie there."""
        ...

    def dip(self, paint: int) -> None:
        """Load the tool from paint `paint` of the palette."""
        ...

    def wipe(self) -> None:
        """Wash and wipe the tool, so that it carries no paint."""
        ...

    def move(self, path: FloatArray) -> FloatArray:
        """Execute one stroke; returns the measured path [N, 5], NaN where nothing was measured."""
        ...

    def force_n(self) -> FloatArray:
        """Normal force at each point of the last move, [N]; [0] where it was not measured."""
        ...

    def lift(self) -> None:
        """Stop where the tool is and raise it off the canvas.

        May be called at any time: from another thread during a move (which then raises), and after a fault. Returns
        when the tool is up; raises where that is not certain.
        """
        ...

    def photo(self) -> Photo:
        """The raw camera frame."""
        ...

    def scan(self) -> FloatArray:
        """Heights of the surface in metres, [H, W]. MissingAbilityError without a scanner."""
        ...

    def new_sheet(self) -> None:
        """Put a blank sheet in the canvas's place."""
        ...

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        ...


@dataclass(frozen=True, eq=False)
class Push:
    """One push or pinch, complete (thesis 7.3.2).

    The tip starts at the surface, travels in a straight line and sinks linearly to its depth at the end; a
    gripper's two fingers are centred at x, y, and close along theta instead of travelling.
    """

    kind: PushKind
    action: FloatArray
    """[5] x_m, y_m, theta_rad, length_m (pinch: closing), depth_m, canvas frame; depth is below the surface."""
    surface_m: float
    """Height above the table of the surface at x, y, as measured before the push."""
    speed_m_s: float
    dwell_s: float
    """Rest at the end of travel."""
    retract_speed_m_s: float


@dataclass(frozen=True, eq=False)
class Place:
    """One pellet, complete: set on the surface at x, y and pressed flat from above."""

    x_m: float
    y_m: float
    volume_m3: float
    """Of the pellet before it is pressed."""
    surface_m: float
    """Height above the table of the surface at x, y, as measured before."""
    press_m: float
    """Height above that surface to which the pellet is pressed."""


def span_m(kind: PushKind, action: FloatArray, opening_m: float) -> FloatArray:
    """The two places [2, 2] between which a push or pinch happens: start and end of travel, or the open fingers."""
    along = np.array([math.cos(action[2]), math.sin(action[2])])
    if kind == "push":
        return np.array([action[:2], action[:2] + action[3] * along])
    return np.array([action[:2] - 0.5 * opening_m * along, action[:2] + 0.5 * opening_m * along])


class SculptingRobot(Protocol):
    """A robot that sculpts one slab.

    The driver decides how the tool travels between pushes. Callers use a robot through
    `control.push_safety.GuardedSculptingRobot`, so that every command is checked.
    """

    @property
    def area_m(self) -> tuple[float, float]:
        """Width and height of the slab; the canvas frame's origin is its lower left corner."""
        ...

    @property
    def clock_s(self) -> float:
        """Seconds on the robot's own clock; every scan carries a time of the same clock."""
        ...

    def change_tool(self, end_effector: EndEffector) -> None:
        """Take the end-effector; nothing happens where it is already held."""
        ...

    def push(self, push: Push) -> FloatArray:
        """Execute a push; returns the measured tip [N, 5] t_s, x_m, y_m, z_m (above the table), yaw_rad.

        NaN where nothing was measured.
        """
        ...

    def place(self, place: Place) -> None:
        """Set a pellet of the material and press it. MissingAbilityError without a feeder."""
        ...

    def lift(self) -> None:
        """Stop where the tool is and raise it off the material; as ``Robot.lift``."""
        ...

    def scan(self) -> Scan:
        """The raw scan, with the tool outside the field of view."""
        ...

    def smooth(self) -> None:
        """Smooth the material, so that it is level and its deformation is erased; by hand where the robot cannot."""
        ...

    def ambient(self) -> dict[str, float]:
        """Readings of the room's sensors: covariates by name, such as temperature_c; {} without sensors."""
        ...

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        ...
