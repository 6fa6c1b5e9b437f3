"""Opening the robot that sculpts: the studio's, its rehearsal for a rig, or hardware with a scanner by a rig file."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError
from pentimento.contracts.frames import image_shape
from pentimento.control.guard import Watchdog
from pentimento.control.journal import JournaledClay
from pentimento.control.open_robot import MAX_AGE_S, driver_of, machine_of
from pentimento.control.place_safety import place_envelope_for
from pentimento.control.push_safety import GuardedSculptingRobot, PushEnvelope, push_envelope_for
from pentimento.control.robot_process import SculptingRobotProcess
from pentimento.robots.calibration import calibrated, read_calibration, require_fresh
from pentimento.robots.driver import Push, SculptingRobot
from pentimento.robots.rig import Rig, load_rig
from pentimento.robots.scanner import Scanner
from pentimento.robots.sculpting import HardwareSculptor, check_push_reach, push_path
from pentimento.robots.tools import EndEffector, Feeder
from pentimento.robots.virtual import virtual_sculpting_robot

FloatArray = NDArray[np.float64]

SCANNERS: Final = "pentimento.scanners"
"""Group of entry points: each names a function from a rig and the shape [H, W] of its height maps to a scanner."""
IN_STUDIO: Final = "virtual"
_JOURNEY_S: Final = 30.0  # of hardware, to a push's start and up
_COMPILES_S: Final = 120.0  # the studio's code may be compiled during its first push
_SAME_M: Final = 1e-6
_LIMITS: Final = {
    "x_min_m": ("x_min_m",),
    "y_min_m": ("y_min_m",),
    "x_max_m": ("x_max_m",),
    "y_max_m": ("y_max_m",),
    "max_press_depth_m": ("max_depth_m",),
    "max_speed_m_s": ("max_speed_m_s", "max_retract_speed_m_s"),
}
"""Limits of the push envelope that a rig's [limits] narrow; its others are of strokes."""


@dataclass(frozen=True, eq=False)
class ClayRobotHandle:
    """An open, guarded robot that sculpts."""

    robot: GuardedSculptingRobot
    in_studio: bool
    """The clay and the clock continue when the process ends."""
    close: Callable[[], None]


def clay_rig(name: str, area_m: tuple[float, float], *, has_feeder: bool, execute: bool) -> Rig | None:
    """The rig of ``--robot`` for a slab of this size; None for the studio's robot.

    Raises:
        ConfigError: no such rig; its canvas is not the slab; it has no scanner; or hardware is to place pellets.
    """
    if name == IN_STUDIO:
        if execute:
            raise ConfigError("The studio's robot needs no --execute; leave it out, or name a rig with --robot.")
        return None
    rig = load_rig(name)
    if not np.allclose(rig.canvas_size_m, area_m, rtol=0, atol=_SAME_M):
        raise ConfigError(
            f"The rig {rig.name} has a canvas of {rig.canvas_size_m[0]:g} by {rig.canvas_size_m[1]:g} m, and the push "
            f"model is of a slab of {area_m[0]:g} by {area_m[1]:g} m; enter the slab's size as canvas in the rig file."
        )
    if not rig.scanner:
        raise ConfigError(
            f"The rig {rig.name} has no scanner, without which nothing is known of the clay; add [scanner] to its file "
            "(docs/on_a_robot.md)."
        )
    if has_feeder:
        raise ConfigError(f"The rig {rig.name} has no feeder, so that no pellet can be placed; leave out --raised.")
    return rig


def open_clay(
    rig: Rig | None,
    end_effector: EndEffector,
    *,
    world: str,
    scan_pixels: int,
    seed: int,
    journal: Path,
    execute: bool,
    calibration: Path,
    ask: Callable[[str], None],
    feeder: Feeder | None,
) -> ClayRobotHandle:
    """The robot for an end-effector, guarded by its envelopes. Without ``execute``, the studio rehearses for hardware.

    Args:
        rig: of ``clay_rig``.
        scan_pixels: of a scan along the slab's longer side.
        journal: of the studio's commands.
        calibration: folder of the rig's calibrations.
        ask: shows a request to the person and returns when it is done.

    Raises:
        ConfigError: no such world, driver or scanner.
        CalibrationError: hardware is to move with a calibration of the touch that is missing, old, or of another rig.
    """
    if rig is not None:
        driver_of(rig)  # before anything is opened, and in a rehearsal as well
        narrowed(push_envelope_for(end_effector, rig.canvas_size_m), rig.limits)
    if rig is not None and execute:
        touch = read_calibration(calibration, "touch")
        require_fresh(touch, rig, time.time(), MAX_AGE_S)
        process = SculptingRobotProcess(connected, (calibrated(rig, touch), scan_pixels), ask)
        return _at_rig(process, rig, end_effector, _JOURNEY_S, in_studio=False, close=process.close)
    journaled = JournaledClay(virtual_sculpting_robot(world, scan_pixels, seed), journal, lambda _: end_effector)
    if rig is not None:
        return _at_rig(journaled, rig, end_effector, _COMPILES_S, in_studio=True, close=journaled.close)
    places = None if feeder is None else place_envelope_for(feeder, journaled.area_m)
    guarded = GuardedSculptingRobot(journaled, push_envelope_for(end_effector, journaled.area_m), places)
    return ClayRobotHandle(guarded, True, journaled.close)


def _at_rig(
    robot: SculptingRobot,
    rig: Rig,
    end_effector: EndEffector,
    journey_s: float,
    *,
    in_studio: bool,
    close: Callable[[], None],
) -> ClayRobotHandle:
    envelope = narrowed(push_envelope_for(end_effector, robot.area_m), rig.limits)
    guarded = RigGuardedSculptor(robot, envelope, rig, journey_s)

    def end() -> None:
        guarded.end_watch()
        close()

    return ClayRobotHandle(guarded, in_studio, end)


def connected(rig: Rig, scan_pixels: int, ask: Callable[[str], None]) -> HardwareSculptor:
    """The rig's robot with its scanner, as ``SculptingRobotProcess`` opens it in its own process."""
    return HardwareSculptor(machine_of(rig), rig, scanner_of(rig, scan_pixels), ask)


def scanner_of(rig: Rig, scan_pixels: int) -> Scanner:
    """The rig's scanner, by its driver's entry point.

    Raises:
        ConfigError: no installed package provides such a driver.
    """
    drivers, name = entry_points(group=SCANNERS), rig.scanner["driver"]
    if name not in drivers.names:
        raise ConfigError(
            f"The rig {rig.name} names the scanner {name!r}, and installed are {sorted(drivers.names)}; install the "
            "package that provides it."
        )
    connect: Callable[[Rig, tuple[int, int]], Scanner] = drivers[name].load()
    return connect(rig, image_shape((0.0, 0.0, *rig.canvas_size_m), scan_pixels / max(rig.canvas_size_m)))


def narrowed(envelope: PushEnvelope, limits: Mapping[str, float]) -> PushEnvelope:
    """The envelope within a rig's limits (``Rig.limits``), which never widen it."""
    found: dict[str, Any] = {}
    for name, ours in _LIMITS.items():
        if name in limits:
            pick = max if "min" in name else min
            found |= {field: pick(getattr(envelope, field), limits[name]) for field in ours}
    return replace(envelope, **found)


class RigGuardedSculptor(GuardedSculptingRobot):
    """A guarded robot at a rig: it refuses pushes out of the rig's reach, and stops those that take too long."""

    def __init__(self, robot: SculptingRobot, envelope: PushEnvelope, rig: Rig, journey_s: float) -> None:
        """`journey_s` is the maximum time of all that is not the push itself."""
        super().__init__(robot, envelope)
        self._rig, self._journey_s = rig, journey_s
        self._watchdog = Watchdog(self.stop)

    def push(self, push: Push) -> FloatArray:
        """Refuses what the guard refuses, and a push out of the rig's reach."""
        self.envelope.check(push)
        check_push_reach(push, self._rig)
        self._watchdog.beat(self._journey_s + 2 * float(push_path(push)[-1, 0]), "a push")
        try:
            return super().push(push)
        finally:
            self._watchdog.rest()

    def end_watch(self) -> None:
        """End the watchdog's thread."""
        self._watchdog.close()
