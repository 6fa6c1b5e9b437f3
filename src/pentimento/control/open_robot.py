"""Opening the robot that a command names: the virtual robot, a drawing in a file, or hardware by its rig file."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from pentimento.calibration.calibrate import camera_of
from pentimento.calibration.observe import CameraCalibration
from pentimento.calibration.webcam import Webcam, corrected
from pentimento.contracts.errors import ConfigError
from pentimento.control.journal import JournaledRobot
from pentimento.control.robot_process import RobotProcess
from pentimento.robots.calibration import Calibration, Kind, calibrated, fresh_calibrations
from pentimento.robots.driver import Robot
from pentimento.robots.gcode import connect as gcode_file
from pentimento.robots.hardware import HardwareRobot
from pentimento.robots.machine import Machine
from pentimento.robots.rig import Rig, load_rig
from pentimento.robots.svg import SvgPlotter
from pentimento.robots.tools import Tool, load_tool
from pentimento.robots.virtual import virtual_robot

DRIVERS = "pentimento.robots"
"""Group of entry points: each names a function from a rig to its machine (docs/writing_a_driver.md)."""
MAX_AGE_S = 24 * 3600.0
"""Maximum age of a calibration with which hardware may move."""

JOURNAL = "journal.jsonl"
"""In a painting's folder: the commands of a robot that is not hardware, see `journal.Journal`."""

_DRAWING, _GCODE = "drawing.svg", "drawing.gcode"
_ON_FILE = "gcode"  # the driver that writes a plotter's commands to a file; nothing moves
_REACH_S = 15.0  # of hardware, to a stroke's start or for one dip
_COMPILES_S = 120.0  # a studio's code may be compiled during its first stroke


@dataclass(frozen=True)
class RobotTraits:
    """Properties of a robot that a session depends on."""

    has_camera: bool
    """Without a camera the canvas is assumed to be as predicted."""
    clock_persists: bool
    """The robot's clock continues when its process ends."""
    reach_s: float
    """Maximum time to a stroke's start, and for each wipe and dip."""
    in_studio: bool = False
    """The studio's robot: a person draws on the page, and paint can be taken off the sheet."""
    calibrated: CameraCalibration | None = None
    """The camera's view of the canvas when the rig was calibrated, where it was."""


@dataclass(frozen=True, eq=False)
class RobotHandle:
    """An open robot, not guarded yet."""

    robot: Robot
    traits: RobotTraits
    close: Callable[[], None]


def rig_named(name: str) -> Rig | None:
    """The rig of ``--robot``; None for the virtual robot and a drawing in a file.

    ``gcode:PORT`` is the bundled plotter at that port; ``gcode`` writes the same commands to a file.

    Raises:
        ConfigError: no such robot, or no installed package provides the rig's driver.
    """
    kind, _, place = name.partition(":")
    if kind == "virtual" or name == "svg":
        return None
    if kind == "gcode":
        if not place:
            return load_rig("plotter_on_file")
        rig = load_rig("plotter")
        return replace(rig, machine={**rig.machine, "port": place})
    rig = load_rig(name)
    driver_of(rig)
    return rig


def is_in_studio(name: str, execute: bool) -> bool:
    """Whether the robot of ``--robot`` is the studio's. Raises ConfigError: no such robot."""
    rig = rig_named(name)
    return name != "svg" if rig is None else not (execute or rig.driver == _ON_FILE)


def open_robot(
    name: str,
    tool: Tool,
    canvas_size_m: tuple[float, float],
    *,
    folder: Path,
    seed: int,
    execute: bool,
    calibration: Path,
    ask: Callable[[str], None],
) -> RobotHandle:
    """The robot of ``--robot``.

    Without ``execute``, hardware is rehearsed: the virtual robot replaces it, with a sheet of the same size, and with a
    camera only if the rig has one, so that the rehearsal makes the plan of the execution.

    Args:
        canvas_size_m: of the sheet, where no rig defines it.
        folder: of the painting, for journals and drawings.
        calibration: folder of the rig's calibrations.
        ask: shows a request to the person and returns when it is done.

    Raises:
        ConfigError: no such robot, or no such driver.
        CalibrationError: hardware is to move with a calibration that is missing, old, or of another rig.
    """
    kind, _, place = name.partition(":")
    rig = rig_named(name)
    if rig is not None and not is_in_studio(name, execute):
        return _hardware(rig, tool, folder=folder, calibration=calibration, ask=ask)
    if name == "svg":
        drawing = SvgPlotter(folder / _DRAWING, canvas_size_m)
        journaled = JournaledRobot(drawing, folder / JOURNAL, load_tool)
        return RobotHandle(journaled, RobotTraits(False, True, _REACH_S), journaled.close)
    world = place if kind == "virtual" and place else tool.name
    robot = virtual_robot(world, canvas_size_m if rig is None else rig.canvas_size_m, seed)
    journaled = JournaledRobot(robot, folder / JOURNAL, lambda _: tool)
    has_camera = rig is None or rig.camera is not None
    return RobotHandle(journaled, RobotTraits(has_camera, True, _COMPILES_S, in_studio=True), journaled.close)


def _hardware(rig: Rig, tool: Tool, *, folder: Path, calibration: Path, ask: Callable[[str], None]) -> RobotHandle:
    if rig.driver == _ON_FILE:
        rig = replace(rig, machine={**rig.machine, "file": str(folder / _GCODE)})
        file = gcode_file(rig)
        on_file = HardwareRobot(file, rig, file.pause if tool.dips else lambda _: None)  # a person fills the wells
        journaled = JournaledRobot(on_file, folder / JOURNAL, load_tool)
        return RobotHandle(journaled, RobotTraits(False, True, _REACH_S), journaled.close)
    found = fresh_calibrations(calibration, rig, time.time(), MAX_AGE_S)
    rig = calibrated(rig, found["touch"])
    robot = RobotProcess(connected, (rig, found), ask)
    canvas = camera_of(found["canvas"]) if "canvas" in found else None
    return RobotHandle(robot, RobotTraits(rig.camera is not None, False, _REACH_S, calibrated=canvas), robot.close)


def connected(rig: Rig, found: Mapping[Kind, Calibration], ask: Callable[[str], None]) -> Robot:
    """The rig's robot with its camera, as ``RobotProcess`` opens it in its own process."""
    camera = None if rig.camera is None else corrected(Webcam(rig.camera), found)
    return HardwareRobot(machine_of(rig), rig, ask, camera)


def driver_of(rig: Rig) -> EntryPoint:
    """The entry point of the rig's driver. No device is opened.

    Raises:
        ConfigError: no installed package provides such a driver.
    """
    drivers = entry_points(group=DRIVERS)
    if rig.driver not in drivers.names:
        raise ConfigError(
            f"The rig {rig.name} names the driver {rig.driver!r}, and installed are {sorted(drivers.names)}; install "
            "the package that provides it."
        )
    return drivers[rig.driver]


def machine_of(rig: Rig) -> Machine:
    """The rig's machine, opened by its driver.

    Raises:
        ConfigError: as `driver_of`; or the driver refuses the rig's [machine].
    """
    connect: Callable[[Rig], Machine] = driver_of(rig).load()
    return connect(rig)
