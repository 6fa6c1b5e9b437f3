"""What `pentimento calibrate` does: write pages to print, or make one calibration of a rig with a person's help."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from pentimento.calibration.calibrate import calibrate
from pentimento.calibration.colour_chart import chart_image
from pentimento.calibration.lens import board_image
from pentimento.calibration.webcam import Webcam
from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import ConfigError
from pentimento.contracts.markers import DICTIONARY, SIDE_M, markers_around
from pentimento.control.guard import GuardedRobot
from pentimento.control.open_robot import machine_of
from pentimento.control.safety import envelope_for
from pentimento.robots.calibration import MAX_RESIDUAL, Calibration, Kind, require_fresh
from pentimento.robots.hardware import HardwareRobot
from pentimento.robots.rig import load_rig
from pentimento.robots.tools import load_tool

PRINT_PX_PER_M: Final = 10_000
"""254 dpi: ten pixels a millimetre."""
_DARK_SRGB = np.array([[0.1, 0.1, 0.1]])
_MAX_AGE_S: Final = 60.0
"""Of the calibration that was just made."""


def calibrate_rig(
    rig_name: str,
    kind: Kind,
    tool_name: str,
    *,
    folder: Path,
    ask: Callable[[str], None],
    ask_yes: Callable[[str], bool],
) -> Calibration:
    """Make one calibration of a rig (its name or file) and write it into `folder`.

    Only the touch connects to the machine. A result with too large a residual is written, so that it can be inspected,
    and then raises CalibrationError.
    """
    rig, tool = load_rig(rig_name), load_tool(tool_name)
    if rig.driver == "gcode":
        raise ConfigError(
            f"The rig {rig.name} writes a file and has nothing to calibrate; calibrate the machine's rig."
        )
    camera = None if rig.camera is None else Webcam(rig.camera)
    try:
        if kind != "touch":
            found = calibrate(
                kind,
                rig,
                folder,
                photograph=camera,
                robot=None,
                tool=tool,
                ask=ask,
                ask_yes=ask_yes,
                clock=time.time,
            )
        else:
            robot = HardwareRobot(machine_of(rig), rig, ask, camera)
            guard = GuardedRobot(robot, envelope_for(tool, rig.canvas_size_m))
            try:
                guard.change_tool(tool)
                if tool.dips:
                    guard.load_palette(_DARK_SRGB)
                found = calibrate(
                    kind,
                    rig,
                    folder,
                    photograph=None if camera is None else guard.photo,
                    robot=guard,
                    tool=tool,
                    ask=ask,
                    ask_yes=ask_yes,
                    clock=time.time,
                )
            finally:
                robot.close()
    finally:
        if camera is not None:
            camera.close()
    require_fresh(found, rig, time.time(), _MAX_AGE_S)
    return found


def yes_at_terminal(question: str) -> bool:
    """Ask the person at the terminal until the answer is y or n."""
    while True:
        answer = input(f"{question} [y/n] ").strip().lower()
        if answer in ("y", "yes", "n", "no"):
            return answer.startswith("y")


def residual_sentence(found: Calibration) -> str:
    """Describe a calibration by its residual and the limit."""
    limit, unit = MAX_RESIDUAL[found.kind]
    return f"The {found.kind} calibration leaves {found.residual:.3g} {unit} (at most {limit:g} {unit} are allowed)."


def write_prints(folder: Path, canvas_size_m: tuple[float, float]) -> list[Path]:
    """Write the pages to print as PNG at 254 dpi: markers round the canvas, the ChArUco board, the colour chart."""
    pages = {
        "charuco_board.png": board_image(300),
        "colour_chart.png": cv2.cvtColor(chart_image(200), cv2.COLOR_RGB2BGR),
    }
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY))
    side_px = round(SIDE_M * PRINT_PX_PER_M)
    for marker in markers_around(canvas_size_m).ids:
        square = cv2.aruco.generateImageMarker(dictionary, marker, side_px)
        quiet = side_px // 5
        pages[f"marker_{marker}.png"] = cv2.copyMakeBorder(
            square, quiet, quiet, quiet, quiet, cv2.BORDER_CONSTANT, value=(255,)
        )
    paths = []
    for name, image in pages.items():
        encoded, data = cv2.imencode(".png", image)
        if not encoded:
            raise ConfigError(f"{name} could not be encoded as PNG.")
        atomic_write(Path(folder) / name, data.tobytes())
        paths.append(Path(folder) / name)
    return paths
