"""The interface of a robot that sculpts: pushes and pinches into a slab, and scans of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.scan import Scan
from pentimento.robots.end_effectors import EndEffector, Kind

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Push:
    """One push or pinch, complete (thesis 7.3.2).

    The tip starts at the surface, travels in a straight line and sinks linearly to its depth at the end; a
    gripper's two fingers are centred at x, y, and close along theta instead of travelling.
    """

    kind: Kind
    action: FloatArray
    """[5] x_m, y_m, theta_rad, length_m (pinch: closing), depth_m, canvas frame; depth is below the surface."""
    surface_m: float
    """Height above the table of the surface at x, y, as measured before the push."""
    speed_m_s: float
    dwell_s: float
    """Rest at the end of travel."""
    retract_speed_m_s: float


def span_m(kind: Kind, action: FloatArray, opening_m: float) -> FloatArray:
    """The two places [2, 2] between which a push or pinch happens: start and end of the way, or the open fingers."""
    along = np.array([math.cos(action[2]), math.sin(action[2])])
    if kind == "push":
        return np.array([action[:2], action[:2] + action[3] * along])
    return np.array([action[:2] - 0.5 * opening_m * along, action[:2] + 0.5 * opening_m * along])


class SculptingRobot(Protocol):
    """A robot that sculpts one slab.

    How the tool travels between pushes is the driver's business. Callers reach a robot through
    `control.push_safety.GuardedSculptingRobot`, so that no command passes unchecked.
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

    def scan(self) -> Scan:
        """The raw scan, with the tool out of the way."""
        ...

    def smooth(self) -> None:
        """Smooth the material, so that it is level and forgets its pushes; by hand, where the robot cannot."""
        ...

    def ambient(self) -> dict[str, float]:
        """What the room's sensors show now: any covariates by name, such as temperature_c; {} without sensors."""
        ...

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        ...
