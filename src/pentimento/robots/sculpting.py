"""A robot that sculpts, composed of a machine, a rig, a scanner, and a person who fits tools and smooths the clay."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import EnvelopeViolation
from pentimento.contracts.observations import Scan
from pentimento.robots.carrier import TipCarrier
from pentimento.robots.driver import MissingAbilityError, Place, Push
from pentimento.robots.journey import check_reach, off_surface, on_surface, poses_of, straight, way_up, ways_to
from pentimento.robots.machine import Machine
from pentimento.robots.rig import Rig
from pentimento.robots.scanner import Scanner
from pentimento.robots.tools import EndEffector

FloatArray = NDArray[np.float64]

CLEARANCE_M: Final = 0.005
"""Minimum height of the travelling tip above the highest point of the last scan."""


def push_path(push: Push) -> FloatArray:
    """The tip's motion [N, 5] of a push, canvas frame, z above the table: in a straight line from the surface to its
    end (thesis 7.3.2), and the rest there.

    The yaw is the direction of travel, or its opposite where that turns the hand less: end-effectors look the same
    after half a turn.

    Raises:
        EnvelopeViolation: a push that goes nowhere.
        MissingAbilityError: a pinch.
    """
    if push.kind != "push":
        raise MissingAbilityError(
            "No driver closes a gripper on clay yet; choose a push model of an end-effector that pushes."
        )
    x_m, y_m, theta, length_m, depth_m = (float(value) for value in push.action)
    yaw = math.remainder(theta, math.pi)
    begin = np.array([x_m, y_m, push.surface_m, yaw])
    end = begin + np.array([length_m * math.cos(theta), length_m * math.sin(theta), -depth_m, 0.0])
    path = straight(begin, end, push.speed_m_s)
    if path is None:
        raise EnvelopeViolation("The push has neither length nor depth; the command was refused.")
    if push.dwell_s > 0:
        path = np.vstack([path, [path[-1, 0] + push.dwell_s, *end]])
    return path


def check_push_reach(push: Push, rig: Rig) -> None:
    """Raise EnvelopeViolation unless a push, the way down to it and the way up lie within the rig's reach, and the tip
    travels above the surface at its start."""
    _check_clear(push.surface_m, rig)
    path = on_surface(push_path(push), rig)
    above = path[0, 1:].copy()
    above[2] = max(rig.travel_height_m, float(above[2]))
    up = way_up(path[-1, 1:], rig, push.retract_speed_m_s)
    for way in (*ways_to(above, path[0, 1:], rig), path, *([] if up is None else [up])):
        check_reach(poses_of(way, rig), rig, "motion to, along or from the push")


def _check_clear(surface_m: float, rig: Rig) -> None:
    if not rig.travel_height_m >= surface_m + CLEARANCE_M:
        raise EnvelopeViolation(
            f"The tip travels {1e3 * rig.travel_height_m:.4g} mm above the table, and the slab is "
            f"{1e3 * surface_m:.4g} mm high; {1e3 * CLEARANCE_M:g} mm must lie between them. Raise [travel] height of "
            "the rig file. The command was refused."
        )


class HardwareSculptor(TipCarrier):
    """A SculptingRobot (see driver.py) on real hardware. Callers reach it through
    `control.push_safety.GuardedSculptingRobot`.

    A push: up, across at travel height, down to the surface, along the push, the rest, and straight up. The slab lies
    with its lower left corner at the origin of the rig's canvas frame, whose z = 0 is the table.
    """

    def __init__(self, machine: Machine, rig: Rig, scanner: Scanner, ask: Callable[[str], None]) -> None:
        """`ask` puts a request to the person and returns when it is done, or raises."""
        super().__init__(machine, rig, ask)
        self._scanner = scanner
        self._tool: EndEffector | None = None
        self._highest_m: float | None = None

    @property
    def area_m(self) -> tuple[float, float]:
        return self._rig.canvas_size_m

    def change_tool(self, end_effector: EndEffector) -> None:
        if self._tool == end_effector:
            return
        self._fit(f"Fit the {end_effector.name} so that its tip is where the rig file says, then confirm.")
        self._tool = end_effector

    def push(self, push: Push) -> FloatArray:
        """Raises EnvelopeViolation, before anything moves, where the tip would hit the clay on its way."""
        if self._highest_m is None:
            raise EnvelopeViolation("The slab was not scanned yet, so that its height is unknown; scan before a push.")
        _check_clear(max(self._highest_m, push.surface_m), self._rig)
        measured = self._travel(on_surface(push_path(push), self._rig), "push", push.retract_speed_m_s)
        return off_surface(measured, self._rig)

    def place(self, place: Place) -> None:
        raise MissingAbilityError(
            f"The rig {self._rig.name} has no feeder, so that no pellet can be placed; leave out --raised."
        )

    def scan(self) -> Scan:
        """With the tip parked. Raises ScannerError."""
        if self._rig.park_m is not None:
            self._park(self._rig.park_m)
        scan = self._scanner.scan()
        self._highest_m = float(np.nanmax(scan.height_m))
        return replace(scan, t_s=self.clock_s)

    def smooth(self) -> None:
        self.lift()
        self._ask("Smooth the material so that it is level, then confirm.")

    def ambient(self) -> dict[str, float]:
        """No driver reads a sensor of the room yet."""
        return {}

    def close(self) -> None:
        try:
            super().close()
        finally:
            self._scanner.close()
