"""Undoing the robot's last batch: sheet, memory, recording and state are as before it, also after a kill."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.control import session, undo
from pentimento.control.checkpoint import PaintingState, load_state
from pentimento.control.open_robot import JOURNAL
from pentimento.control.painter import PaintContext, replanned_and_pruned
from pentimento.control.person import Control
from pentimento.control.recording import RECORD
from pentimento.control.session import resume
from pentimento.control.undo import take_back
from pentimento.planning.strokes.bezier import Strokes
from tests.bundle.line_brush import journaled_sheet, sheet
from tests.control.paintings import BATCH, begun, session_of

LINE = json.dumps({"points": [[0.1, 0.9, 0.5], [0.9, 0.9, 0.5]]})


def painted(folder: Path, person: Callable[[PaintingState, Control], None]) -> PaintingState:
    """One session in turns of the painting in a folder."""
    robot, control = journaled_sheet(folder), Control()
    if not (folder / "state.npz").exists():
        begun(robot, folder)
    beside = session_of(robot, folder, control, lambda s: person(s, control), in_turns=True, in_studio=True)
    try:
        return resume(beside)
    finally:
        robot.close()


def undo_at_turn(state: PaintingState, control: Control) -> None:
    if state.phase == "your turn":
        control.send("undo")


def stop_at_turn(state: PaintingState, control: Control) -> None:
    if state.phase == "your turn":
        control.send("stop")


def test_undo_restores_sheet_recording_and_state_of_before_the_batch(tmp_path: Path) -> None:
    states: list[PaintingState] = []

    def person(state: PaintingState, control: Control) -> None:
        states.append(state)
        undo_at_turn(state, control)

    due = painted(tmp_path, person)
    before = next(state for state in states if state.executed == (due.executed - 1) // BATCH * BATCH)
    assert due.phase == "undoing" and before.executed < due.executed
    back = take_back(tmp_path)
    assert back.phase == "undone" and back.executed == before.executed and len(back.remaining)
    assert (back.memory.ink == before.memory.ink).all() and back.memory.tool_age_m == before.memory.tool_age_m
    moves = [line for line in (tmp_path / JOURNAL).read_text().splitlines() if line.startswith('["move"')]
    assert len(moves) == before.executed
    assert read_table(tmp_path / RECORD, CONTRACT).table["order"].to_pylist() == list(range(before.executed))
    # The studio shows the sheet as it was, and the person is asked before anything is painted.
    seen: list[PaintingState] = []

    def look(state: PaintingState, control: Control) -> None:
        seen.append(state)
        stop_at_turn(state, control)

    stopped = painted(tmp_path, look)
    assert stopped.executed == before.executed and all(not state.pending for state in seen)
    waiting = next(state for state in seen if state.phase == "your turn")
    assert waiting.message.startswith("The robot's last") and "undone" in waiting.message
    assert np.abs(waiting.canvas.astype(int) - before.canvas).max() < 30  # the camera's noise
    assert np.abs(waiting.canvas.astype(int) - due.canvas).max() > 60


def test_undone_painting_goes_on_with_a_recording_without_gaps(tmp_path: Path) -> None:
    painted(tmp_path, undo_at_turn)
    back = take_back(tmp_path)
    went_on = []

    def person(state: PaintingState, control: Control) -> None:
        if state.phase == "your turn":
            control.send("stop" if went_on else "go on")
            went_on.append(state.executed)

    done = painted(tmp_path, person)
    assert done.executed > back.executed and done.phase == "done"
    orders = read_table(tmp_path / RECORD, CONTRACT).table["order"].to_pylist()
    assert orders == list(range(done.executed))


def test_undo_again_goes_back_one_batch_more(tmp_path: Path) -> None:
    first = painted(tmp_path, undo_at_turn).executed
    executed = [first]
    while executed[-1] > 0:
        executed.append(take_back(tmp_path).executed)
        if executed[-1] > 0:
            assert painted(tmp_path, undo_at_turn).phase == "undoing"
    assert executed[1:] == list(range((first - 1) // BATCH * BATCH, -1, -BATCH))


def test_undone_strokes_are_planned_again_on_what_the_person_draws(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    painted(tmp_path, undo_at_turn)
    take_back(tmp_path)
    orders, planned_on = iter([("draw", LINE), ("go on",), ("stop",)]), list[np.ndarray]()

    def plan(context: PaintContext, remaining: Strokes, canvas: np.ndarray, **rest: Any) -> Strokes:
        planned_on.append(canvas)
        return replanned_and_pruned(context, remaining, canvas, **rest)

    monkeypatch.setattr(session, "replanned_and_pruned", plan)
    drawn: list[PaintingState] = []

    def person(state: PaintingState, control: Control) -> None:
        if state.phase == "your turn":
            control.send(*next(orders))
            drawn.append(state)

    painted(tmp_path, person)
    assert len(planned_on) == 2  # at the start of the session, and after the person's line
    assert np.abs(planned_on[1].astype(int) - drawn[1].canvas).max() < 30  # the camera's noise
    assert np.abs(planned_on[1].astype(int) - planned_on[0]).max() > 60


def test_refused_line_leaves_what_can_be_undone(tmp_path: Path) -> None:
    orders = iter([("draw", json.dumps({"points": [[2.0, 2.0, 0.5]]})), ("undo",)])

    def person(state: PaintingState, control: Control) -> None:
        if state.phase == "your turn":
            control.send(*next(orders))

    assert painted(tmp_path, person).phase == "undoing"


def test_undo_that_was_killed_is_finished(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    painted(tmp_path, undo_at_turn)
    for name in ("remove_shards", "save_state"):

        def die(*_: object) -> None:
            raise KeyboardInterrupt

        monkeypatch.setattr(undo, name, die)
        with pytest.raises(KeyboardInterrupt):
            take_back(tmp_path)
        monkeypatch.undo()
        assert load_state(tmp_path).phase == "undoing"
    back = take_back(tmp_path)
    assert painted(tmp_path, stop_at_turn).executed == back.executed


def test_undo_during_a_batch_takes_back_its_strokes(tmp_path: Path) -> None:
    def person(state: PaintingState, control: Control) -> None:
        if state.executed == BATCH + 2 and state.phase == "painting" and not state.pending:
            control.send("undo")

    assert painted(tmp_path, person).phase == "undoing"
    assert take_back(tmp_path).executed == BATCH


def test_what_cannot_be_undone_is_one_sentence_and_changes_nothing(tmp_path: Path) -> None:
    said, orders = [], iter([("draw", LINE), ("undo",), ("stop",)])

    def person(state: PaintingState, control: Control) -> None:
        if state.phase == "your turn":
            said.append(state)
            control.send(*next(orders))

    done = painted(tmp_path, person)
    assert done.phase == "done" and done.executed == said[0].executed
    assert said[2].message.startswith("The robot has painted nothing since you last drew or asked")
    assert (said[2].canvas == said[1].canvas).all()


def test_paint_on_a_real_sheet_stays(tmp_path: Path) -> None:
    robot, control, said = sheet(), Control(), []
    begun(robot, tmp_path)

    def person(state: PaintingState) -> None:
        if state.phase == "your turn":
            said.append(state.message)
            control.send("undo" if len(said) == 1 else "stop")

    done = resume(session_of(robot, tmp_path, control, person, in_turns=True))
    assert done.phase == "done" and said[1].startswith("Paint cannot be taken off a real sheet")
