"""Faults while painting: the tool is lifted in time, the state is saved, resuming finishes (docs/running.md)."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pentimento.contracts.observations import Photo
from pentimento.control import session, workplace
from pentimento.control.camera import PaintingFault
from pentimento.control.checkpoint import PaintingState, load_state
from pentimento.control.guard import StoppedError
from pentimento.control.session import resume
from tests.bundle.line_brush import sheet
from tests.control.faulty import FaultyRobot, Frozen, black, shifted, slid, with_a_hand
from tests.control.paintings import STROKES, begun, error_of, finished, session_of

AT = 5
"""Number of the stroke with the fault."""
WITHIN_S = 0.5
"""Maximum time from the fault to the lift, in addition to the watchdog's deadline."""


@pytest.fixture
def robot(tmp_path: Path) -> FaultyRobot:
    """A robot whose painting is planned and not begun."""
    robot = FaultyRobot(sheet())
    begun(robot, tmp_path)
    return robot


def _fails(
    robot: FaultyRobot, folder: Path, error: type[BaseException], kind: str | None = None, **more: Any
) -> tuple[BaseException, PaintingState]:
    with pytest.raises(error) as raised:
        resume(session_of(robot, folder, **more))
    if kind is not None:
        assert isinstance(raised.value, PaintingFault) and raised.value.kind == kind
    state = load_state(folder)
    assert state.phase == "stopped" and state.message == str(raised.value)
    assert robot.lifts and time.monotonic() - robot.lifts[-1] < 10  # the last command was a lift
    return raised.value, state


def _mended(robot: FaultyRobot, folder: Path) -> PaintingState:
    robot.on_move = lambda _number, path: path
    robot.on_photo = lambda photo: photo
    done = finished(robot, folder)
    assert AT <= done.executed <= STROKES and error_of(done, folder) < 0.65
    return done


def test_fault_lost_link_lifts_and_resumes(robot: FaultyRobot, tmp_path: Path) -> None:
    lost_s = 0.0

    def lose(number: int, path: np.ndarray) -> np.ndarray:
        nonlocal lost_s
        if number == AT:
            lost_s = time.monotonic()
            raise OSError("the cable is out.")
        return path

    robot.on_move = lose
    _, state = _fails(robot, tmp_path, OSError)
    assert state.executed == AT - 1 and state.pending
    assert any(0 <= lifted - lost_s < WITHIN_S for lifted in robot.lifts)
    _mended(robot, tmp_path)


@pytest.mark.parametrize(
    ("look", "kind", "text"),
    [
        (black, "camera", "shows nothing"),
        (Frozen(), "camera", "same picture"),
        (shifted, "moved", "has moved"),
        (with_a_hand, "hand", "hand"),
        (slid, "slid", "slid"),
    ],
)
def test_fault_untrusted_photograph_stops_and_resumes(
    robot: FaultyRobot, tmp_path: Path, look: Callable[[Photo], Photo], kind: str, text: str
) -> None:
    def fails(number: int, path: np.ndarray) -> np.ndarray:
        if number == AT:
            robot.on_photo = look
        return path

    robot.on_move = fails
    error, state = _fails(robot, tmp_path, PaintingFault, kind)
    assert text in str(error)
    # A frozen picture is detected at the next one; after the other faults nothing moves.
    after = 1 if isinstance(look, Frozen) else 0
    assert state.executed == AT - 1 + after and robot.moves == AT + after
    assert (
        _mended(robot, tmp_path).executed == robot.moves
    )  # the stroke before the fault was visible, and not executed again


def test_fault_hand_that_leaves_is_waited_for(robot: FaultyRobot, tmp_path: Path) -> None:
    seen = 0

    def hand(photo: Photo) -> Photo:
        nonlocal seen
        seen += 1
        return with_a_hand(photo) if 6 <= seen < 12 else photo

    robot.on_photo = hand
    assert finished(robot, tmp_path).executed == robot.moves
    assert seen > 12 + robot.moves - 6


def test_fault_covered_markers_are_waited_for(robot: FaultyRobot, tmp_path: Path) -> None:
    seen = 0

    def covered(photo: Photo) -> Photo:
        nonlocal seen
        seen += 1
        if 6 <= seen < 10:
            photo.frame[:, : photo.frame.shape[1] // 3] = 90
            photo.frame[: photo.frame.shape[0] // 3] = 90
        return photo

    robot.on_photo = covered
    assert finished(robot, tmp_path).executed == robot.moves


def test_fault_dry_tool_restores_unmarked_strokes(robot: FaultyRobot, tmp_path: Path) -> None:
    def dry(number: int, path: np.ndarray) -> np.ndarray:
        return path + np.array([0, 0, 0, 0.004, 0]) if number >= AT else path

    robot.on_move = dry
    error, state = _fails(robot, tmp_path, PaintingFault, "no mark")
    assert "no mark" in str(error) and state.executed == AT - 1  # the five without a mark are restored
    assert robot.moves == AT + 4
    _mended(robot, tmp_path)


def test_fault_late_heartbeat_lifts_and_stops(robot: FaultyRobot, tmp_path: Path) -> None:
    stuck, stuck_s = threading.Event(), 0.0
    reach_s = 1.0

    def hang(number: int, path: np.ndarray) -> np.ndarray:
        nonlocal stuck_s
        if number == AT:
            stuck_s = time.monotonic()
            stuck.wait(20)  # until a lift
        return path

    def lift() -> None:
        robot.lifts.append(time.monotonic())
        if stuck_s:
            stuck.set()

    robot.on_move, robot.lift = hang, lift  # type: ignore[method-assign]
    error, state = _fails(robot, tmp_path, StoppedError, reach_s=reach_s)
    assert f"stroke {AT} took longer" in str(error) and state.pending
    late = min(lifted - stuck_s for lifted in robot.lifts if lifted > stuck_s)
    max_stroke_s = 1.5  # 50 mm at 60 mm/s, and its ends
    assert reach_s < late < reach_s + 1.5 * max_stroke_s + WITHIN_S
    robot.lift = lambda: None  # type: ignore[method-assign]
    robot.on_move = lambda _number, path: path
    assert finished(robot, tmp_path).executed >= AT


def test_fault_full_disk_keeps_the_last_state(
    robot: FaultyRobot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, full = workplace.save_state, False

    def save(folder: Path, state: PaintingState) -> None:
        nonlocal full
        full = full or (state.executed == AT - 1 and not state.pending)
        if full:
            raise OSError(28, "No space left on device")
        real(folder, state)

    for module in (session, workplace):
        monkeypatch.setattr(module, "save_state", save)
    with pytest.raises(OSError, match="No space") as raised:
        resume(session_of(robot, tmp_path))
    assert "could not be written down" in raised.value.__notes__[0]
    assert robot.moves == AT - 1 and robot.lifts
    monkeypatch.undo()
    state = load_state(tmp_path)
    assert state.executed == AT - 2 and state.pending  # the last saved state: the stroke was pending
    assert _mended(robot, tmp_path).executed == robot.moves


def test_fault_keyboard_interrupt_lifts_and_resumes(robot: FaultyRobot, tmp_path: Path) -> None:
    def interrupt(number: int, path: np.ndarray) -> np.ndarray:
        if number == AT:
            raise KeyboardInterrupt
        return path

    robot.on_move = interrupt
    with pytest.raises(KeyboardInterrupt):
        resume(session_of(robot, tmp_path))
    assert load_state(tmp_path).phase == "stopped" and robot.lifts
    _mended(robot, tmp_path)
