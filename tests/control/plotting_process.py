"""Test support: a painting on a plotter at a port, in its own process."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from pentimento.control.checkpoint import PaintingState
from pentimento.control.guard import GuardedRobot
from pentimento.control.open_robot import RobotHandle, open_robot
from pentimento.control.person import Control
from pentimento.control.safety import envelope_for
from pentimento.control.session import begin, resume
from pentimento.control.workplace import PaintingSession, Proposal
from pentimento.robots.calibration import Calibration, write_calibration
from pentimento.robots.rig import load_rig
from pentimento.robots.tools import load_tool
from tests.bundle.line_brush import SIDE_M, cross, paint_context
from tests.robots.small_plotter import small_plotter

UP_MM, PAPER_MM = -5.0, -10.0


def opened(folder: Path, port: str) -> RobotHandle:
    """The plotter at a port, with a current touch calibration."""
    rig_file = folder / "small.toml"
    rig_file.write_text(small_plotter(port))
    touch = Calibration("touch", load_rig(rig_file).digest, time.time(), "a test", 0.0, {"surface": [0.0, 0.0, 0.0]})
    write_calibration(folder / "calibration", touch)
    return open_robot(
        str(rig_file), load_tool("marker"), (SIDE_M, SIDE_M), folder=folder, seed=1, execute=True,
        calibration=folder / "calibration", ask=lambda _: None,
    )  # fmt: skip


def paint(folder: Path, robot: RobotHandle, strokes: int) -> PaintingState:
    """Begin or resume a painting, and finish it; prints the number of each stroke that begins."""
    own = paint_context()
    guarded = GuardedRobot(robot.robot, envelope_for(own.tool, (SIDE_M, SIDE_M)))

    def on_state(state: PaintingState) -> None:
        if state.pending:
            print(state.executed, flush=True)

    session = PaintingSession(
        guarded, robot.traits, own, strokes, 4, folder, Control(), on_state, lambda canvas, _: Proposal([cross(canvas)])
    )
    if not (folder / "state.npz").exists():
        begin(session, cross, log=lambda _name, _value, _step: None)
    return resume(session)


if __name__ == "__main__":
    paint(Path(sys.argv[1]), opened(Path(sys.argv[1]), sys.argv[2]), 3)
