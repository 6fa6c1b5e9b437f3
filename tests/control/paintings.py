"""Test support: small paintings of the studio's robot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import to_float
from pentimento.contracts.errors import ConfigError
from pentimento.contracts.images import read_image
from pentimento.control.checkpoint import PaintingState
from pentimento.control.guard import GuardedRobot
from pentimento.control.open_robot import RobotTraits
from pentimento.control.painter import as_linear, objective_value
from pentimento.control.person import Control
from pentimento.control.pictures import GOAL
from pentimento.control.safety import envelope_for
from pentimento.control.session import begin, resume
from pentimento.control.workplace import PaintingSession, Proposal
from pentimento.planning.strokes.memory import Start
from pentimento.robots.driver import Robot
from tests.bundle.line_brush import SIDE_M, cross, paint_context

STROKES, BATCH = 14, 4
Picture = NDArray[np.uint8]


def session_of(
    robot: Robot,
    folder: Path,
    control: Control | None = None,
    on_state: Callable[[PaintingState], None] = lambda _: None,
    *,
    reach_s: float = 60.0,
    goals_for: Callable[[Picture, str], Proposal] | None = None,
    in_turns: bool = False,
    in_studio: bool = False,
) -> PaintingSession:
    """A session with a newly guarded robot in a folder."""
    own = paint_context()
    guarded = GuardedRobot(robot, envelope_for(own.tool, (SIDE_M, SIDE_M)))
    traits = RobotTraits(has_camera=True, clock_persists=True, reach_s=reach_s, in_studio=in_studio)
    control = Control() if control is None else control
    return PaintingSession(
        guarded, traits, own, STROKES, BATCH, folder, control, on_state, goals_for or _nothing_new, in_turns=in_turns
    )


def _nothing_new(_canvas: Picture, words: str) -> Proposal:
    raise ConfigError(f"{words!r} is not understood.")


def begun(robot: Robot, folder: Path) -> PaintingState:
    """A painting that is planned, without an executed stroke."""
    return begin(session_of(robot, folder), cross, log=lambda _name, _value, _step: None)


def finished(robot: Robot, folder: Path) -> PaintingState:
    """A painting resumed and finished."""
    state = resume(session_of(robot, folder))
    assert state.phase == "done", state.message
    return state


def error_of(state: PaintingState, folder: Path) -> float:
    """The canvas's objective as a fraction of blank paper's."""
    goal = read_image(folder / GOAL)
    blank = np.full_like(goal, round(255 * float(np.median(to_float(goal)))))
    start = Start(state.memory, state.clock_s, state.executed)
    own = paint_context()
    return objective_value(own, as_linear(state.canvas), goal, start) / objective_value(
        own, as_linear(blank), goal, start
    )
