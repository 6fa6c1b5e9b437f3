"""Test support: a painting on a plotter at a port, in a process of its own."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from pentimento.control.commands import Control
from pentimento.control.open_robot import RobotHandle, open_robot
from pentimento.control.painting_state import State
from pentimento.control.safety import GuardedRobot, envelope_for
from pentimento.control.session import LoopTiming, Sitting, begin, carry_on
from pentimento.robots.calibration import Calibration, write_calibration
from pentimento.robots.rig import load_rig
from pentimento.robots.tools import load_tool
from tests.bundle.line_brush import SIDE_M, cross, paint_context

RIG = """
name = "small"
driver = "grbl"
canvas = ["100 mm", "100 mm"]
[canvas_to_robot]
origin = ["20 mm", "20 mm", "-10 mm"]
turn = ["0 deg", "0 deg", "0 deg"]
[reach]
low = ["0 mm", "0 mm", "-14 mm"]
high = ["380 mm", "280 mm", "0 mm"]
[travel]
height = "5 mm"
speed = "80 mm/s"
[machine]
port = "{port}"
baud = 115200
pen = "z"
"""
UP_MM, PAPER_MM = -5.0, -10.0


def opened(folder: Path, port: str) -> RobotHandle:
    """The plotter at a port, by a touch calibration of now."""
    rig_file = folder / "small.toml"
    rig_file.write_text(RIG.format(port=port))
    touch = Calibration("touch", load_rig(rig_file).digest, time.time(), "a test", 0.0, {"surface": [0.0, 0.0, 0.0]})
    write_calibration(folder / "calibration", touch)
    return open_robot(
        str(rig_file), load_tool("marker"), (SIDE_M, SIDE_M), folder, 1, True, folder / "calibration", lambda _: None
    )  # fmt: skip


def paint(folder: Path, robot: RobotHandle, strokes: int) -> State:
    """Begin or take up a painting, to its end; prints each stroke that is begun."""
    own = paint_context()
    guarded = GuardedRobot(robot.robot, envelope_for(own.tool, (SIDE_M, SIDE_M)))
    timing = LoopTiming(4, robot.reach_s, robot.sees, robot.clock_goes_on)

    def tell(state: State) -> None:
        if state.begun:
            print(state.made, flush=True)

    sitting = Sitting(guarded, own, timing, folder, Control(), tell)
    if not (folder / "state.npz").exists():
        begin(sitting, cross, strokes, lambda _name, _value, _step: None)
    return carry_on(sitting)


if __name__ == "__main__":
    paint(Path(sys.argv[1]), opened(Path(sys.argv[1]), sys.argv[2]), 6)
