"""Painting sessions on the virtual robot: the loop, turns of a person, and recordings."""

import math
from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.colour import to_float
from pentimento.contracts.images import read_image
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.control.checkpoint import PaintingState, load_state
from pentimento.control.person import Control
from pentimento.control.pictures import CANVAS, GOAL, NEXT, PREVIEW
from pentimento.control.session import RECORD, resume
from pentimento.planning.strokes.bezier import to_planned
from tests.bundle.line_brush import POINTS, journaled_sheet, sheet
from tests.control.paintings import BATCH, STROKES, begun, error_of, finished, session_of

Painted = tuple[Path, PaintingState, PaintingState]
"""A folder, the first state and the last one."""


@pytest.fixture(scope="module")
def painted(tmp_path_factory: pytest.TempPathFactory) -> Painted:
    folder = tmp_path_factory.mktemp("painting")
    robot = sheet()
    planned = begun(robot, folder)
    return folder, planned, finished(robot, folder)


def test_session_executes_all_strokes_and_reduces_the_error(
    painted: Painted,
) -> None:
    folder, planned, done = painted
    assert (
        0 < len(planned.remaining) <= STROKES and done.executed == len(planned.remaining) and len(done.remaining) == 0
    )
    assert error_of(done, folder) < 0.6


def test_session_result_is_close_to_the_predicted_plan(painted: Painted) -> None:
    folder, planned, done = painted
    plan = to_float(read_image(folder / "plan.png"))
    blank, now = to_float(planned.canvas), to_float(done.canvas)
    assert np.square(plan - now).mean() < 0.35 * np.square(blank - now).mean()


def test_session_records_each_stroke_in_order(painted: Painted) -> None:
    folder, _, done = painted
    found = read_table(folder / RECORD, CONTRACT)
    rows = found.table.to_pylist()
    assert not found.quarantined
    assert [row["order"] for row in rows] == list(range(done.executed))
    assert len(list((folder / RECORD).glob("*.parquet"))) == math.ceil(done.executed / BATCH)
    assert [row["tool_age_m"] for row in rows] == sorted(row["tool_age_m"] for row in rows)
    assert all(row["before"]["bytes"] != row["after"]["bytes"] for row in rows)
    times = [row[name] for row in rows for name in ("t_before_s", "t_start_s", "t_after_s")]
    assert times == sorted(times)


def test_session_writes_canvas_preview_next_and_goal_pictures(
    painted: Painted,
) -> None:
    folder, _, done = painted
    assert np.array_equal(read_image(folder / CANVAS), done.canvas)
    assert read_image(folder / NEXT).shape == (3 * done.canvas.shape[0], 3 * done.canvas.shape[1], 3)
    assert np.array_equal(read_image(folder / PREVIEW), done.canvas)  # nothing remains to be predicted
    assert read_image(folder / GOAL).shape == done.canvas.shape


def test_session_of_a_finished_painting_executes_no_stroke(painted: Painted) -> None:
    folder, _, done = painted
    robot = sheet()
    assert resume(session_of(robot, folder)).executed == done.executed
    assert robot.clock_s < 20  # it observed, and executed no stroke


def test_session_resumes_on_the_same_canvas_after_stop(tmp_path: Path) -> None:
    first = journaled_sheet(tmp_path)
    planned = len(begun(first, tmp_path).remaining)
    control = Control()

    def stop_after_five(state: PaintingState) -> None:
        if state.executed == 5:
            control.send("stop")

    state = resume(session_of(first, tmp_path, control, stop_after_five))
    assert state.phase == "stopped" and state.executed == 5
    first.close()
    again = journaled_sheet(tmp_path)
    assert again.clock_s == first.clock_s
    done = finished(again, tmp_path)
    assert planned - 2 <= done.executed <= planned and done.sessions == 2 and error_of(done, tmp_path) < 0.6
    rows = read_table(tmp_path / RECORD, CONTRACT).table
    assert rows["session"].to_pylist() == ["painting-0"] * 5 + ["painting-1"] * (done.executed - 5)
    assert rows["tool_age_m"].to_pylist() == sorted(rows["tool_age_m"].to_pylist())
    starts = rows["t_start_s"].to_pylist()
    assert starts == sorted(starts)


def test_session_replans_after_a_persons_turn(tmp_path: Path, painted: Painted) -> None:
    robot = sheet()
    planned = len(begun(robot, tmp_path).remaining)
    control = Control()
    turned = False

    def person(state: PaintingState) -> None:
        nonlocal turned
        if state.executed == 5 and not turned:
            turned = True
            control.send("your turn")
        if state.phase == "your turn":
            for stroke in to_planned(state.remaining, beside.context.tool, POINTS):  # the robot's remaining strokes
                robot.move(stroke.path)
            control.send("go on")

    beside = session_of(robot, tmp_path, control, person)
    done = resume(beside)
    assert done.phase == "done" and done.turns == 1
    assert done.executed <= planned
    assert (tmp_path / "turns" / "001.png").exists()
    # The robot did not repeat the person's strokes: together they reach a lower error than the robot alone.
    alone, _, by_itself = painted
    assert error_of(done, tmp_path) < error_of(by_itself, alone)


def test_session_pause_lifts_the_tool_until_go_on(tmp_path: Path) -> None:
    robot = sheet()
    begun(robot, tmp_path)
    control, phases = Control(), []

    def person(state: PaintingState) -> None:
        phases.append(state.phase)
        if state.executed == 2 and "paused" not in phases:
            control.send("pause")
        if state.phase == "paused":
            assert not state.pending
            control.send("go on")

    assert resume(session_of(robot, tmp_path, control, person)).phase == "done"
    assert "paused" in phases


def test_session_stops_while_waiting_for_a_turn(tmp_path: Path) -> None:
    robot = sheet()
    begun(robot, tmp_path)
    control = Control()
    control.send("your turn")

    def person(state: PaintingState) -> None:
        if state.phase == "your turn":
            control.send("stop")

    state = resume(session_of(robot, tmp_path, control, person))
    assert state.phase == "stopped" and state.executed == 0 and load_state(tmp_path).phase == "stopped"
