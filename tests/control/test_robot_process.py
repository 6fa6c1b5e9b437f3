"""A robot in its own process: commands and errors pass; it lifts when its commander is gone or silent."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.errors import EnvelopeViolation, PentimentoError
from pentimento.control.robot_process import SILENT_S, RobotGone, RobotProcess, SculptingRobotProcess
from pentimento.robots.driver import MissingAbilityError, Place, Push
from pentimento.robots.tools import load_end_effector, load_tool
from pipelines._imports import ROOT
from tests.control.clay_machine import make_sculptor
from tests.control.slow_robot import STROKE, broken, make
from tests.robots.machines import make_rig

WITHIN_S = 1.0
"""Maximum time from the commander's end to the lift."""


def _last(log: Path) -> tuple[str, float]:
    what, when = log.read_text().splitlines()[-1].split()
    return what, float(when)


def _waits_for(log: Path, what: str, within_s: float) -> float:
    deadline_s = time.monotonic() + within_s
    while time.monotonic() < deadline_s:
        if log.exists() and _last(log)[0] == what:
            return _last(log)[1]
        time.sleep(0.01)
    raise AssertionError(f"{what} did not come within {within_s} s.")


@pytest.fixture
def apart(tmp_path: Path) -> Iterator[tuple[RobotProcess, Path, list[str]]]:
    asked: list[str] = []
    robot = RobotProcess(make, (tmp_path / "log",), asked.append)
    yield robot, tmp_path / "log", asked
    robot.close()


def test_robot_process_passes_commands_results_requests_and_errors(apart: tuple[RobotProcess, Path, list[str]]) -> None:
    robot, log, asked = apart
    assert robot.canvas_size_m == (0.1, 0.1) and robot.clock_s > 0
    robot.change_tool(load_tool("marker"))
    assert asked == ["Fit the marker."]
    short = STROKE * [0.001, 1, 1, 1, 1]
    assert np.array_equal(robot.move(short), short) and _last(log)[0] == "up"
    assert robot.photo().frame.shape == (4, 4, 3) and robot.scan().shape == (2, 2)
    with pytest.raises(ValueError, match="no wells"):
        robot.load_palette(np.zeros((1, 3)))


def test_robot_process_lift_interrupts_a_move(apart: tuple[RobotProcess, Path, list[str]]) -> None:
    robot, log, _ = apart
    failed: list[Exception] = []

    def draw() -> None:
        try:
            robot.move(STROKE)
        except RuntimeError as error:
            failed.append(error)

    drawing = threading.Thread(target=draw)
    drawing.start()
    _waits_for(log, "down", 5)
    started_s = time.monotonic()
    robot.lift()
    drawing.join(5)
    assert time.monotonic() - started_s < WITHIN_S and _last(log)[0] == "up" and str(failed[0]) == "halted."


@pytest.mark.parametrize(
    ("end", "within_s"), [(signal.SIGKILL, WITHIN_S), (signal.SIGSTOP, SILENT_S + WITHIN_S)], ids=["killed", "hangs"]
)
def test_robot_process_lifts_when_its_commander_ends(tmp_path: Path, end: signal.Signals, within_s: float) -> None:
    log = tmp_path / "log"
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.control.slow_robot", str(log)],
        cwd=ROOT, stdout=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": str(ROOT / "src")},
    )  # fmt: skip
    assert process.stdout is not None and process.stdout.readline() == "drawing\n"
    _waits_for(log, "down", 10)
    ended_s = time.monotonic()
    process.send_signal(end)
    assert _waits_for(log, "up", 10) - ended_s < within_s
    process.kill()
    process.wait()
    process.stdout.close()


def test_robot_process_that_ended_raises_robot_gone(tmp_path: Path) -> None:
    robot = RobotProcess(make, (tmp_path / "log",), lambda _: None)
    robot._process.kill()
    with pytest.raises(RobotGone, match="tool is up"):
        robot.wait(60)
    robot.close()


def test_robot_process_reports_why_opening_failed(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no robot"):
        RobotProcess(broken, (tmp_path / "log",), lambda _: None)


def test_robot_process_unconfirmed_request_fails_the_command(tmp_path: Path) -> None:
    def away(_request: str) -> None:
        raise EOFError

    robot = RobotProcess(make, (tmp_path / "log",), away)
    with pytest.raises(PentimentoError, match="Fit the marker"):
        robot.change_tool(load_tool("marker"))
    robot.close()


def test_sculpting_robot_process_passes_pushes_scans_requests_and_errors() -> None:
    asked: list[str] = []
    rig = make_rig(canvas_size_m=(0.2, 0.2), travel_height_m=0.06, palette=None)
    robot = SculptingRobotProcess(make_sculptor, (rig,), asked.append)
    try:
        assert robot.area_m == (0.2, 0.2) and robot.clock_s > 0 and robot.ambient() == {}
        robot.change_tool(load_end_effector("ball"))
        push = Push("push", np.array([0.1, 0.1, 0.0, 0.03, 0.006]), 0.03, 0.02, 0.0, 0.05)
        with pytest.raises(EnvelopeViolation, match="not scanned yet"):
            robot.push(push)
        before = robot.scan()
        measured = robot.push(push)
        assert measured[-1, 1:4] == pytest.approx([0.13, 0.1, 0.024], abs=1e-9)
        assert (before.height_m - robot.scan().height_m).max() == pytest.approx(0.006, abs=5e-4)
        with pytest.raises(MissingAbilityError, match="no feeder"):
            robot.place(Place(0.1, 0.1, 1e-7, 0.03, 0.002))
        robot.smooth()
        robot.wait(0.0)
        robot.lift()
        assert [words.split()[0] for words in asked] == ["Fit", "Smooth"]
    finally:
        robot.close()
