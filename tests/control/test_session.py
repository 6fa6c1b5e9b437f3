"""Painting sessions on the virtual robot: the loop, turns of a person, and recordings."""

import json
import math
import threading
from dataclasses import asdict, replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from pentimento.contracts.colour import to_float
from pentimento.contracts.images import read_image
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.control.checkpoint import PaintingState, load_state, save_state
from pentimento.control.expression import PLAIN
from pentimento.control.guard import GuardedRobot
from pentimento.control.open_robot import RobotTraits
from pentimento.control.page import Page, Pen
from pentimento.control.person import Control
from pentimento.control.pictures import CANVAS, GOAL, NEXT, PREVIEW
from pentimento.control.recording import RECORD
from pentimento.control.safety import envelope_for
from pentimento.control.session import begin, resume
from pentimento.control.workplace import PaintingSession, Proposal
from pentimento.planning.strokes.config import no_log
from pentimento.robots.tools import load_tool
from pentimento.robots.virtual import VirtualRobot
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import load_world
from tests.bundle.line_brush import POINTS, SIDE_M, journaled_sheet, paint_context, sheet
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


def test_other_light_after_a_resume_is_not_a_wish(tmp_path: Path) -> None:
    first, control = journaled_sheet(tmp_path), Control()
    planned = len(begun(first, tmp_path).remaining)

    def stop_after_five(state: PaintingState) -> None:
        if state.executed == 5:
            control.send("stop")

    stopped = resume(session_of(first, tmp_path, control, stop_after_five))
    first.close()
    lighter = np.minimum(stopped.canvas.astype(int) + 25, 255).astype(np.uint8)  # as it was in the light of that day
    save_state(tmp_path, replace(stopped, canvas=lighter))
    done = finished(journaled_sheet(tmp_path), tmp_path)
    np.testing.assert_array_equal(done.goal, stopped.goal)
    assert done.executed >= planned - 2


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
            for stroke in state.remaining.planned(beside.context.tool, POINTS):  # the robot's remaining strokes
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


def one_bar(canvas: np.ndarray, _words: str) -> Proposal:
    """The canvas with a bar on the left."""
    return Proposal(bars(canvas)[:1])


def two_bars(canvas: np.ndarray, _words: str) -> Proposal:
    """The canvas with a bar on the left, or with one on the right."""
    return Proposal(bars(canvas), ["a bar: drawn as a line"])


def bars(canvas: np.ndarray) -> list[np.ndarray]:
    """The canvas with a bar on the left, and with one on the right."""
    goals = [canvas.copy(), canvas.copy()]
    goals[0][10:-10, 8:11] = 40
    goals[1][10:-10, -11:-8] = 40
    return goals


def test_person_asks_for_something_new_and_chooses_one_of_the_goals(tmp_path: Path) -> None:
    robot, control, phases = sheet(), Control(), []
    begun(robot, tmp_path)

    def person(state: PaintingState) -> None:
        phases.append(state.phase)
        if state.executed == 3 and "your turn" not in phases:
            control.send("your turn")
        if state.phase == "your turn" and "choosing" not in phases:
            control.send("wish", "a bar")
        if state.phase == "choosing":
            assert (read_image(tmp_path / "goals" / "2.png") != read_image(tmp_path / "goals" / "1.png")).any()
            control.send("choose", "7")  # there is none
            threading.Timer(0.2, control.send, ("choose", "2")).start()

    beside = session_of(robot, tmp_path, control, person, goals_for=two_bars)
    done = resume(beside)
    assert done.phase == "done" and done.turns == 1 and "choosing" in phases
    asked = json.loads((tmp_path / "turns" / "001.json").read_text())
    assert asked.pop("expression") == asdict(PLAIN)
    assert asked == {
        "number": 1,
        "words": "a bar",
        "executed_before": 3,
        "planned": done.executed - 3,
        "things": [],
        "lines": 0,
    }
    assert (read_image(tmp_path / "turns" / "001_goal.png") == done.goal).all()
    before = read_image(tmp_path / "turns" / "001.png")
    before = cv2.resize(before, done.canvas.shape[1::-1], interpolation=cv2.INTER_AREA).astype(int)
    new = before.min(-1) - done.canvas.min(-1) > 60
    right, left = new[:, new.shape[1] // 2 :].sum(), new[:, : new.shape[1] // 2].sum()
    assert right > 100 and left < 0.1 * right


def test_pause_is_not_ended_by_a_number_or_a_line(tmp_path: Path) -> None:
    robot, control, executed = sheet(), Control(), []
    begun(robot, tmp_path)

    def person(state: PaintingState) -> None:
        if state.executed == 2 and state.phase == "painting" and not executed:
            control.send("pause")
        if state.phase == "paused":
            executed.append(state.executed)
            control.send("choose", "1")
            threading.Timer(0.2, control.send, ("draw", "[]")).start()
            threading.Timer(0.4, lambda: executed.append(load_state(tmp_path).executed)).start()
            threading.Timer(0.6, control.send, ("stop",)).start()

    state = resume(session_of(robot, tmp_path, control, person))
    assert state.phase == "stopped" and executed == [2, 2] and state.executed == 2


def test_choice_among_earlier_goals_is_not_a_choice_among_later_ones(tmp_path: Path) -> None:
    robot, control, chosen = sheet(), Control(), []
    begun(robot, tmp_path)
    control.send("wish", "a bar")

    def goals(canvas: np.ndarray, words: str) -> Proposal:
        control.send("choose", "1")  # before the goals are shown
        return two_bars(canvas, words)

    def person(state: PaintingState) -> None:
        if state.phase == "choosing" and not chosen:
            chosen.append(state.message)
            threading.Timer(0.2, control.send, ("choose", "2")).start()

    done = resume(session_of(robot, tmp_path, control, person, goals_for=goals))
    assert (done.goal == bars(done.goal)[1]).all() and done.phase == "done"
    assert chosen[0].endswith("A bar: drawn as a line.")


@pytest.mark.parametrize("number", ["0", "3", "9" * 5000])
def test_number_of_no_goal_is_not_a_choice(tmp_path: Path, number: str) -> None:
    robot, control, choices = sheet(), Control(), []
    begun(robot, tmp_path)
    control.send("wish", "a bar")

    def person(state: PaintingState) -> None:
        if state.phase == "choosing" and not choices:
            choices.append(number)
            control.send("choose", number)
            threading.Timer(0.2, control.send, ("choose", "2")).start()

    done = resume(session_of(robot, tmp_path, control, person, goals_for=two_bars))
    assert (done.goal == bars(done.goal)[1]).all() and done.phase == "done"


def test_wish_on_resume_may_be_stopped_at_the_choice(tmp_path: Path) -> None:
    robot, control = journaled_sheet(tmp_path), Control()
    begun(robot, tmp_path)
    before = finished(robot, tmp_path)
    robot.close()

    def person(state: PaintingState) -> None:
        if state.phase == "choosing":
            control.send("stop")

    again = journaled_sheet(tmp_path)
    state = resume(session_of(again, tmp_path, control, person, goals_for=two_bars), "a bar")
    assert state.phase == "stopped" and state.executed == before.executed


def test_page_takes_lines_also_after_your_turn_was_said_twice(tmp_path: Path) -> None:
    robot, control, answers = journaled_sheet(tmp_path), Control(), []
    begun(robot, tmp_path)
    page = Page(tmp_path, control, Pen(0.02, None))
    control.send("your turn")
    unanswered = threading.Timer(10, control.send, ("stop",))
    unanswered.start()

    def person(state: PaintingState) -> None:
        page.show(state)
        if state.phase == "your turn":
            if answers:
                answers.append(page.post("draw", b'{"points": [[0.5, 0.5, 0.5]]}').status)
                control.send("stop")
            else:
                answers.append(page.post("command", b"your turn").status)

    resume(session_of(robot, tmp_path, control, person, in_studio=True))
    unanswered.cancel()
    page.close()
    assert answers[:2] == [204, 200]


def test_painting_in_turns_resumes_at_the_persons_turn(tmp_path: Path) -> None:
    robot, control, phases = sheet(), Control(), []
    begun(robot, tmp_path)
    save_state(tmp_path, replace(load_state(tmp_path), phase="choosing", sessions=1))

    def person(state: PaintingState) -> None:
        phases.append((state.phase, state.executed))
        if state.phase == "your turn":
            control.send("stop")

    resume(session_of(robot, tmp_path, control, person, in_turns=True))
    assert ("your turn", 0) in phases and all(executed == 0 for _, executed in phases)


@pytest.mark.parametrize("interrupted", ["your turn", "undoing"])
def test_what_waits_for_a_person_does_so_also_after_an_interruption(tmp_path: Path, interrupted: str) -> None:
    robot, control = journaled_sheet(tmp_path), Control()
    begun(robot, tmp_path)

    def person(state: PaintingState) -> None:
        if state.phase == interrupted:
            raise KeyboardInterrupt
        if state.executed == 2 and state.phase == "painting" and not state.pending:
            control.send("your turn")
        if state.phase == "your turn":
            control.send("undo")

    with pytest.raises(KeyboardInterrupt):
        resume(session_of(robot, tmp_path, control, person, in_turns=True, in_studio=True))
    assert load_state(tmp_path).phase == interrupted
    robot.close()


def test_resumed_session_does_not_say_why_the_last_one_ended(tmp_path: Path) -> None:
    robot, control, messages = journaled_sheet(tmp_path), Control(), []
    begun(robot, tmp_path)
    control.send("your turn")

    def interrupt(state: PaintingState) -> None:
        if state.phase == "your turn":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        resume(session_of(robot, tmp_path, control, interrupt, in_turns=True))
    assert load_state(tmp_path).message == "Interrupted."
    control.send("stop")
    resume(session_of(robot, tmp_path, control, lambda state: messages.append(state.message), in_turns=True))
    robot.close()
    assert messages[0] == "The painting is resumed." and "Interrupted." not in messages


def test_wish_that_is_not_understood_leaves_goal_and_turn_as_they_are(tmp_path: Path) -> None:
    robot, control, messages = sheet(), Control(), []
    first = begun(robot, tmp_path)

    def person(state: PaintingState) -> None:
        messages.append(state.message)
        if state.executed == 2 and state.phase == "painting" and not state.turns:
            control.send("wish", "florb")
        if "not understood" in state.message:
            assert state.phase == "your turn"
            control.send("go on")

    done = resume(session_of(robot, tmp_path, control, person))
    assert done.phase == "done" and (done.goal == first.goal).all()
    assert any("'florb' is not understood" in message for message in messages)
    assert json.loads((tmp_path / "turns" / "001.json").read_text())["words"] == ""


def test_painting_in_turns_waits_for_the_person_until_stop(tmp_path: Path) -> None:
    robot, control, turns = sheet(), Control(), []
    planned = len(begun(robot, tmp_path).remaining)

    def person(state: PaintingState) -> None:
        if state.phase == "your turn":
            turns.append(state.executed)
            control.send(*(("wish", "a bar") if len(turns) == 1 else ("stop",)))

    beside = session_of(robot, tmp_path, control, person, goals_for=one_bar, in_turns=True)
    done = resume(beside)
    assert done.phase == "done" and len(done.remaining) == 0
    assert len(turns) == 2 and abs(turns[0] - planned) <= 2 and turns[1] > turns[0]


def test_finished_painting_is_resumed_with_a_wish(tmp_path: Path) -> None:
    robot = journaled_sheet(tmp_path)
    begun(robot, tmp_path)
    before = finished(robot, tmp_path)
    robot.close()
    again = journaled_sheet(tmp_path)
    done = resume(session_of(again, tmp_path, goals_for=one_bar), "a bar")
    assert done.phase == "done" and done.executed > before.executed and done.turns == 1
    left = np.s_[:, : before.canvas.shape[1] // 6]
    assert (before.canvas[left].min(-1).astype(int) - done.canvas[left].min(-1) > 60).sum() > 40


def test_person_draws_with_a_brush_and_a_colour_before_any_plan(tmp_path: Path) -> None:
    control, phases = Control(), []
    world = load_world("round_brush")
    studio = VirtualRobot(Studio(replace(world, paper=replace(world.paper, size_m=(SIDE_M, SIDE_M))), 1))
    robot = journaled_sheet(tmp_path, studio)
    context = replace(paint_context(), tool=load_tool("round_brush"))

    def person(state: PaintingState) -> None:
        if state.phase == "your turn":
            phases.append(state.lines)
            if not state.lines and len(phases) == 1:
                line = {"points": [[0.2, 0.3, 0.6], [0.8, 0.3, 0.6]], "color": [0.1, 0.2, 0.8]}
                control.send("draw", json.dumps(line))
            elif len(phases) == 2:
                control.send("draw", "no line")
            else:
                control.send("stop")

    session = PaintingSession(
        GuardedRobot(robot, envelope_for(context.tool, (SIDE_M, SIDE_M))),
        RobotTraits(has_camera=True, clock_persists=True, reach_s=60.0, in_studio=True),
        context, STROKES, BATCH, tmp_path, control, person, lambda canvas, _: Proposal([canvas]), in_turns=True,
    )  # fmt: skip
    begin(session, lambda canvas: canvas, log=no_log)
    done = resume(session)
    assert done.phase == "done" and done.executed == 0 and done.lines == 2
    height, width = done.canvas.shape[:2]
    red, _, blue = done.canvas[round(0.3 * height), width // 2].astype(int)
    assert blue > red + 60
    assert (done.canvas[round(0.7 * height)] > 150).all()
