"""Sessions whose process is killed, on the virtual robot and on a simulated plotter."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.control.checkpoint import load_state
from pentimento.control.recording import RECORD
from pentimento.robots.simulated_grbl import SimulatedGrbl
from pipelines._imports import ROOT
from tests.bundle.line_brush import journaled_sheet
from tests.control.paintings import STROKES, error_of, finished
from tests.control.plotting_process import PAPER_MM, UP_MM, opened, paint


@pytest.mark.timeout(300)
def test_session_killed_twice_is_finished_by_resuming(tmp_path: Path) -> None:
    chance = random.Random(4)
    for kill_after in (2, 6):
        process = subprocess.Popen(
            [sys.executable, "-m", "tests.control.painting_process", str(tmp_path)],
            cwd=ROOT, stdout=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": str(ROOT / "src")},
        )  # fmt: skip
        assert process.stdout is not None
        for line in process.stdout:
            if int(line) >= kill_after:
                break
        time.sleep(chance.uniform(0, 0.15))  # anywhere in the next strokes
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL
        process.stdout.close()
    before = load_state(tmp_path)
    assert 6 <= before.executed < STROKES
    done = finished(journaled_sheet(tmp_path), tmp_path)
    assert done.sessions == 3 and len(done.remaining) == 0 and error_of(done, tmp_path) < 0.65
    recorded = read_table(tmp_path / RECORD, CONTRACT)
    assert not recorded.quarantined and done.executed - 2 <= recorded.table.num_rows <= done.executed


WITHIN_S = 2.0
"""Maximum time until the pen is up: it brakes, the controller is reset, and the pen rises 5 mm at 20 mm/s."""


def test_plotter_session_draws_each_stroke_and_ends_with_pen_up(tmp_path: Path) -> None:
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


def test_plotter_session_killed_lifts_the_pen_and_resumes(tmp_path: Path) -> None:
    plotter = SimulatedGrbl()  # at a real plotter's speed
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
        done = paint(tmp_path, robot, 3)
    finally:
        robot.close()
    assert done.phase == "done" and done.sessions == 2 and not len(done.remaining)
    assert plotter.place_mm[2] == UP_MM
    plotter.close()
