"""A painting on hardware that is not there: the simulated plotter, driven by a process of its own."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from pentimento.control.checkpoint import load_state
from pentimento.robots.simulated_grbl import SimulatedGrbl
from pipelines._imports import ROOT
from tests.control.plotting_process import PAPER_MM, UP_MM, opened, paint

WITHIN_S = 2.0
"""Of its commander's end, the pen is up: it brakes, the controller is reset, and it rises 5 mm at 20 mm/s."""


def test_a_plotter_draws_what_is_planned_and_is_left_with_its_pen_up(tmp_path: Path) -> None:
    plotter = SimulatedGrbl(hurry=20.0)
    robot = opened(tmp_path, plotter.port)
    try:
        state = paint(tmp_path, robot, 4)
    finally:
        robot.close()
    assert state.phase == "done" and state.executed > 0
    landings = [
        now for before, now in zip(plotter.trace, plotter.trace[1:], strict=False) if before[2] > PAPER_MM >= now[2]
    ]
    assert len(landings) == state.executed  # the pen came down once for each stroke
    assert all(20 <= x <= 120 and 20 <= y <= 120 for x, y, z, _ in plotter.trace if z <= PAPER_MM)
    assert plotter.place_mm[2] == UP_MM
    plotter.close()


def test_a_painting_that_is_killed_leaves_the_pen_up_and_is_finished(tmp_path: Path) -> None:
    plotter = SimulatedGrbl()  # at a real plotter's speed, so that a stroke takes its time
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.control.plotting_process", str(tmp_path), plotter.port],
        cwd=ROOT, stdout=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT / "src"), os.environ.get("PYTHONPATH", "")])},
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stdout.readline() == "0\n" and process.stdout.readline() == "1\n"  # the second stroke is begun
    deadline_s = time.monotonic() + 10
    while plotter.place_mm[2] > PAPER_MM:
        assert time.monotonic() < deadline_s
        time.sleep(0.002)
    killed_s = time.monotonic()
    process.send_signal(signal.SIGKILL)
    while plotter.place_mm[2] < UP_MM:
        assert time.monotonic() - killed_s < WITHIN_S
        time.sleep(0.002)
    process.wait()
    process.stdout.close()
    state = load_state(tmp_path)
    assert state.pending and state.executed == 1
    robot = opened(tmp_path, plotter.port)
    try:
        done = paint(tmp_path, robot, 6)
    finally:
        robot.close()
    assert done.phase == "done" and done.sessions == 2 and not len(done.remaining)
    assert plotter.place_mm[2] == UP_MM
    plotter.close()
