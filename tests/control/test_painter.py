"""Planning, replanning and painting strokes on the virtual robot."""

from dataclasses import replace

import numpy as np
import pytest

from pentimento.contracts.covariates import fresh_memory
from pentimento.contracts.plan import PlannedStroke
from pentimento.control.guard import GuardedRobot
from pentimento.control.painter import (
    Painting,
    add_persons_paint,
    as_linear,
    as_picture,
    due_for_dip,
    first_plan,
    keep_persons_paint,
    objective_value,
    paint,
    predict,
    predict_canvas,
    replan_rest,
    replanned,
    replanned_and_pruned,
)
from pentimento.control.safety import envelope_for
from pentimento.dynamics.strokes.extended import StrokeModel
from pentimento.dynamics.strokes.planned import TorchBrush
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.brush import Span, StrokeTiming
from pentimento.planning.strokes.memory import Start, planned_covariates
from pentimento.planning.strokes.planner import plan
from pentimento.planning.strokes.scene import Scene, objective_for, scene_with
from pentimento.robots.driver import Robot
from pentimento.robots.refill import needs_dip
from pentimento.robots.tools import load_tool
from pentimento.robots.virtual import VirtualRobot
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import load_world
from tests.bundle.line_brush import SIDE_M, cross, paint_context
from tests.planning.strokes.scenes import CONFIG, unheard

MARKER = load_tool("marker")
SQUARE_M = (0.1, 0.1)
MODEL = StrokeModel(
    Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 0.1, 1.5e-3, 0.2, 0.95),
    (),
    {"order": Span(0, 9, 99)},
    StrokeTiming(3.0, 0.0),
)
INK = replace(CONFIG, palette=replace(CONFIG.palette, source="ink", size=None), pixels_per_m=400.0, edge_m=0.004)


def robot() -> Robot:
    world = load_world("marker")
    hand = VirtualRobot(Studio(replace(world, paper=replace(world.paper, size_m=SQUARE_M)), 0))
    return GuardedRobot(hand, envelope_for(MARKER, SQUARE_M))


def scene() -> Scene:
    """A dark bar across the sheet."""
    target = np.full((40, 40, 3), 0.9, np.float32)
    target[15:26, 5:35] = 0.02
    return scene_with(TorchBrush(MODEL, MARKER, CONFIG.path_points), MARKER, SQUARE_M, target)


Logged = tuple[Painting, list[tuple[str, float, int]]]
"""A painting and what was logged."""


@pytest.fixture(scope="module")
def painted() -> Logged:
    blank = np.full((40, 40, 3), 0.9, np.float32)
    strokes, palette = plan(blank, scene(), 12, INK, unheard)
    logged: list[tuple[str, float, int]] = []
    painting = paint(
        robot(), scene(), strokes, palette_srgb=palette, replan_every=5, replan=True, config=INK,
        log=lambda *what: logged.append(what),
    )  # fmt: skip
    return painting, logged


def test_paint_executes_every_stroke_and_photographs_every_batch(
    painted: Logged,
) -> None:
    painting, logged = painted
    assert len(painting.executed) == 12 and isinstance(painting.executed[0], PlannedStroke)
    assert len(painting.photos) == 1 + 3 == len(painting.deviation)
    assert [(name, count) for name, _, count in logged] == [("deviation", 5), ("deviation", 10), ("deviation", 12)]
    assert painting.deviation[0] == 0 and [value for _, value, _ in logged] == painting.deviation[1:]
    dark = [(photo.mean(-1) < 128).sum() for photo in painting.photos]
    assert dark[0] == 0 and (np.diff(dark) >= 0).all() and dark[-1] > 0


def test_paint_reduces_the_objective(
    painted: Logged,
) -> None:
    objective = objective_for(scene(), INK)
    before, after = (objective(as_linear(photo))[0] for photo in (painted[0].photos[0], painted[0].photos[-1]))
    assert after < 0.9 * before  # twelve strokes of a pen cover little


def test_replan_rest_adapts_to_a_changed_canvas() -> None:
    """A person painted the left half of the bar: the strokes planned there move to the right half."""
    blank = np.full((40, 40, 3), 230, np.uint8)
    half = blank.copy()
    half[15:26, 5:20] = 30
    strokes, _ = plan(as_linear(blank), scene(), 6, INK, unheard)
    objective = objective_for(scene(), INK)

    def ends(left: object) -> float:
        return objective(as_linear(np.rint(255 * np.clip(predict(left, half, scene()), 0, 1)).astype(np.uint8)))[0]

    harder = replace(INK, iterations_replan=20, replan_rate=0.5)
    moved = replan_rest(strokes, half, scene(), harder, palette_srgb=INK_SRGB)
    assert ends(moved) < ends(strokes)
    assert moved.inherited is None


def test_covariates_of_remaining_strokes_follow_the_start() -> None:
    blank = np.full((40, 40, 3), 0.9, np.float32)
    strokes, _ = plan(blank, scene(), 6, INK, unheard)
    here = scene()
    whole = planned_covariates(strokes, MARKER, here.brush, here.start, names=("order",))
    rest = planned_covariates(
        strokes.pick(slice(4, None)), MARKER, here.brush, replace(here.start, made=4), names=("order",)
    )
    np.testing.assert_array_equal(rest["order"], whole["order"][4:])


CONTEXT = paint_context()
PAPER = np.full((60, 60, 3), 238, np.uint8)
GOAL = cross(PAPER)
START = Start(fresh_memory((SIDE_M, SIDE_M), 0.002), 0.0, 0)
INK_SRGB = np.zeros((1, 3))


def _error(picture: np.ndarray) -> float:
    return objective_value(CONTEXT, as_linear(picture), GOAL, START)


@pytest.fixture(scope="module")
def planned() -> Strokes:
    return first_plan(CONTEXT, PAPER, GOAL, count=14, start=START, log=lambda _name, _value, _step: None)[0]


def test_first_plan_and_each_stroke_reduce_the_objective(planned: Strokes) -> None:
    whole = _error(as_picture(predict_canvas(CONTEXT, planned, PAPER, START)))
    assert whole < 0.6 * _error(PAPER)
    for left_out in range(len(planned)):
        others = planned.pick(np.delete(np.arange(len(planned)), left_out))
        assert _error(as_picture(predict_canvas(CONTEXT, others, PAPER, START))) > whole * 0.999


def test_replanned_reduces_the_objective_on_a_displaced_canvas(planned: Strokes) -> None:
    first, rest = planned.pick(slice(0, 5)), planned.pick(slice(5, None))
    first.middle_m += np.float32(0.003)  # displaced by the robot
    canvas = as_picture(predict_canvas(CONTEXT, first, PAPER, START))
    before = rest.middle_m.copy()
    again = replanned(CONTEXT, rest, canvas, goal=GOAL, start=START, palette_srgb=INK_SRGB)
    assert np.array_equal(rest.middle_m, before)  # the arguments are unchanged
    errors = [_error(as_picture(predict_canvas(CONTEXT, strokes, canvas, START))) for strokes in (rest, again)]
    assert errors[1] < errors[0]


def test_replanned_and_pruned_removes_strokes_that_a_person_made_redundant(planned: Strokes) -> None:
    assert len(replanned_and_pruned(CONTEXT, planned, GOAL, goal=GOAL, start=START, palette_srgb=INK_SRGB)) == 0
    assert (
        len(replanned_and_pruned(CONTEXT, planned, PAPER, goal=GOAL, start=START, palette_srgb=INK_SRGB))
        >= len(planned) - 2
    )


def test_what_a_person_paints_becomes_part_of_the_goal() -> None:
    goal, before = np.full((20, 30, 3), 200, np.uint8), np.full((20, 30, 3), 245, np.uint8)
    now = before.copy()
    now[5:8, 10:20] = [40, 40, 160]
    kept = keep_persons_paint(goal, before, now)
    np.testing.assert_array_equal(kept[5:8, 10:20], now[5:8, 10:20])
    np.testing.assert_array_equal(kept[4, 10:20], now[4, 10:20])  # a rim, where a line is soft
    untouched = np.ones((20, 30), bool)
    untouched[4:9, 9:21] = False
    np.testing.assert_array_equal(kept[untouched], goal[untouched])
    np.testing.assert_array_equal(keep_persons_paint(goal, before, before), goal)


def test_add_persons_paint_marks_changed_cells_and_time() -> None:
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
def test_due_for_dip_applies_to_brushes_only(name: str) -> None:
    tool, color = load_tool(name), np.array([0.2, 0.3, 0.4])
    memory = replace(START.memory, since_reload=1, last_color_srgb=color)
    stroke = PlannedStroke(np.zeros((2, 5)), color, dip=False)
    assert not needs_dip(tool, stroke, memory, None)
    assert needs_dip(tool, stroke, due_for_dip(memory, tool), None) == tool.dips
