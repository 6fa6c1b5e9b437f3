"""What the runner plans with at the canvas: plans that help, replans that go on, memories that follow a person."""

from dataclasses import replace

import numpy as np
import pytest

from pentimento.contracts.covariates import fresh_memory
from pentimento.contracts.plan import PlannedStroke
from pentimento.control.painter import (
    add_persons_paint,
    as_linear,
    as_picture,
    due_for_dip,
    first_plan,
    objective_value,
    predict_canvas,
    replanned,
    replanned_and_pruned,
)
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.memory import Start
from pentimento.robots.dipping import needs_dip
from pentimento.robots.tools import load_tool
from tests.bundle.line_brush import SIDE_M, cross, paint_context

OWN = paint_context()
PAPER = np.full((60, 60, 3), 238, np.uint8)
GOAL = cross(PAPER)
START = Start(fresh_memory((SIDE_M, SIDE_M), 0.002), 0.0, 0)


def _error(picture: np.ndarray) -> float:
    return objective_value(OWN, as_linear(picture), GOAL, START)


@pytest.fixture(scope="module")
def planned() -> Strokes:
    return first_plan(OWN, PAPER, GOAL, count=14, start=START, log=lambda _name, _value, _step: None)[0]


def test_a_plan_helps_and_each_of_its_strokes_does(planned: Strokes) -> None:
    whole = _error(as_picture(predict_canvas(OWN, planned, PAPER, START)))
    assert whole < 0.6 * _error(PAPER)
    for left_out in range(len(planned)):
        others = planned.pick(np.delete(np.arange(len(planned)), left_out))
        assert _error(as_picture(predict_canvas(OWN, others, PAPER, START))) > whole * 0.999


def test_replanning_makes_the_best_of_what_came_out_otherwise(planned: Strokes) -> None:
    first, rest = planned.pick(slice(0, 5)), planned.pick(slice(5, None))
    first.middle_m += np.float32(0.003)  # the robot has drawn beside
    canvas = as_picture(predict_canvas(OWN, first, PAPER, START))
    before = rest.middle_m.copy()
    again = replanned(OWN, rest, canvas, goal=GOAL, start=START)
    assert np.array_equal(rest.middle_m, before)  # what was given stays as it was
    errors = [_error(as_picture(predict_canvas(OWN, strokes, canvas, START))) for strokes in (rest, again)]
    assert errors[1] < errors[0]


def test_strokes_that_a_person_has_made_needless_are_given_up(planned: Strokes) -> None:
    assert len(replanned_and_pruned(OWN, planned, GOAL, goal=GOAL, start=START)) == 0
    assert len(replanned_and_pruned(OWN, planned, PAPER, goal=GOAL, start=START)) >= len(planned) - 2


def test_a_persons_paint_is_remembered_where_and_when_it_came() -> None:
    now = PAPER.copy()
    now[30:, :30] = 60  # the lower left quarter
    memory = add_persons_paint(START.memory, PAPER, now, 42.0)
    rows, columns = memory.ink.shape
    lower_left = memory.ink[rows // 2 :, : columns // 2]
    assert np.all(lower_left == 1) and memory.ink.sum() == lower_left.sum()
    painted = ~np.isnan(memory.painted_at_s)
    assert np.all(memory.painted_at_s[painted] == 42.0) and painted.sum() == lower_left.size
    assert np.all(START.memory.ink == 0)


@pytest.mark.parametrize("name", ["marker", "round_brush"])
def test_a_brush_that_has_waited_is_dipped_first_and_a_pen_never(name: str) -> None:
    tool, color = load_tool(name), np.array([0.2, 0.3, 0.4])
    memory = replace(START.memory, since_reload=1, last_color_srgb=color)
    stroke = PlannedStroke(np.zeros((2, 5)), color, dip=False)
    assert not needs_dip(tool, stroke, memory)
    assert needs_dip(tool, stroke, due_for_dip(memory, tool)) == tool.dips
