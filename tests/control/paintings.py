"""Test support: small paintings of the studio's robot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from pentimento.contracts.colour import to_float
from pentimento.contracts.images import read_image
from pentimento.control.commands import Control
from pentimento.control.paint_context import as_linear, error
from pentimento.control.painting_state import State
from pentimento.control.safety import GuardedRobot, envelope_for
from pentimento.control.session import GOAL, LoopTiming, Sitting, begin, carry_on
from pentimento.planning.strokes.memory import Start
from pentimento.robots.driver import Robot
from tests.bundle.line_brush import SIDE_M, cross, paint_context

STROKES, BATCH = 14, 4


def sitting(
    robot: Robot,
    folder: Path,
    control: Control | None = None,
    tell: Callable[[State], None] = lambda _: None,
    reach_s: float = 60.0,
) -> Sitting:
    """Who paints with a robot, guarded anew, in a folder."""
    own = paint_context()
    guarded = GuardedRobot(robot, envelope_for(own.tool, (SIDE_M, SIDE_M)))
    timing = LoopTiming(batch=BATCH, reach_s=reach_s, sees=True, clock_goes_on=True)
    return Sitting(guarded, own, timing, folder, Control() if control is None else control, tell)


def begun(robot: Robot, folder: Path) -> State:
    """A painting that is planned, with no stroke made."""
    return begin(sitting(robot, folder), cross, STROKES, lambda _name, _value, _step: None)


def finished(robot: Robot, folder: Path) -> State:
    """A painting taken up and brought to its end."""
    state = carry_on(sitting(robot, folder))
    assert state.phase == "done", state.sentence
    return state


def error_of(state: State, folder: Path) -> float:
    """How far the canvas is from the goal, as a share of blank paper's distance."""
    goal = read_image(folder / GOAL)
    blank = np.full_like(goal, round(255 * float(np.median(to_float(goal)))))
    start = Start(state.memory, state.clock_s, state.made)
    own = paint_context()
    return error(own, as_linear(state.canvas), goal, start) / error(own, as_linear(blank), goal, start)
