"""What an expression changes: the goal's colours, the tool's strokes and its speed; and that PLAIN changes nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pentimento.contracts.colour import srgb_to_lab, to_float
from pentimento.contracts.images import read_image
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.control.expression import PLAIN, Expression
from pentimento.control.person import Control
from pentimento.control.recording import RECORD
from pentimento.control.session import resume
from pentimento.control.turn import expression_in, read_turns
from pentimento.control.workplace import Proposal
from pentimento.robots.tools import load_tool
from tests.bundle.line_brush import journaled_sheet, paint_context, sheet
from tests.control.paintings import begun, session_of

VIVID = Expression("fast", chroma=1.3, lightness=5.0, length=1.5, tempo=1.25)
CALM = Expression("slowly", chroma=0.7, lightness=-5.0, length=0.6, tempo=0.8)
TOOLS = ("marker", "round_brush", "flat_brush")


def colours(seed: int = 0) -> NDArray[np.uint8]:
    """Colours of the middle of the gamut."""
    return np.random.default_rng(seed).integers(90, 160, (20, 30, 3)).astype(np.uint8)


def test_plain_changes_nothing() -> None:
    goal, tool, context = colours(), load_tool("round_brush"), paint_context()
    assert PLAIN.goal(goal, np.full_like(goal, 245)) is goal
    assert PLAIN.tool(tool) is tool and context.about("a cat", PLAIN) is context


def test_a_goal_keeps_the_canvas_where_it_equals_it() -> None:
    canvas = np.full((20, 30, 3), 245, np.uint8)
    goal = canvas.copy()
    goal[5:15, 5:15] = (150, 100, 90)
    changed = VIVID.goal(goal, canvas)
    kept = np.ones((20, 30), bool)
    kept[5:15, 5:15] = False
    assert (changed[kept] == canvas[kept]).all() and (changed[~kept] != goal[~kept]).any(-1).all()


@pytest.mark.parametrize("expression", [VIVID, CALM])
def test_chroma_is_multiplied_lightness_is_shifted_and_hue_stays(expression: Expression) -> None:
    goal = colours()
    before = srgb_to_lab(to_float(goal))
    after = srgb_to_lab(to_float(expression.goal(goal, np.full_like(goal, 255))))
    assert after[..., 0] - before[..., 0] == pytest.approx(expression.lightness, abs=0.7)
    assert after[..., 1:] == pytest.approx(expression.chroma * before[..., 1:], abs=1.5)


def test_a_goal_near_the_canvas_changes_little() -> None:
    canvas = np.full((1, 8, 3), 240, np.uint8)
    goal = canvas - np.arange(8, dtype=np.uint8)[None, :, None]
    change = np.abs(CALM.goal(goal, canvas).astype(int) - goal).max(-1)[0]
    assert change[0] == 0 and (np.diff(change) >= 0).all() and change[-1] <= 12


@pytest.mark.parametrize("name", TOOLS)
@pytest.mark.parametrize("expression", [VIVID, CALM, Expression("", 1.0, 0.0, 100.0, 100.0)])
def test_strokes_and_speed_stay_within_the_tools_ranges(name: str, expression: Expression) -> None:
    tool, changed = load_tool(name), expression.tool(load_tool(name))
    low, high = changed.stroke_length_m
    assert tool.stroke_length_m[0] <= low <= high <= tool.stroke_length_m[1]
    assert tool.speed_range_m_s[0] <= changed.speed_m_s <= tool.speed_range_m_s[1]
    assert replace(changed, stroke_length_m=tool.stroke_length_m, speed_m_s=tool.speed_m_s) == tool
    assert (low > tool.stroke_length_m[0]) == (expression.length > 1)
    assert (high < tool.stroke_length_m[1]) == (expression.length < 1)


def test_a_robot_is_no_faster_than_it_may_be() -> None:
    tool = load_tool("marker")
    assert VIVID.tool(tool, max_speed_m_s=0.065).speed_m_s == 0.065
    assert VIVID.tool(tool, max_speed_m_s=0.01).speed_m_s == tool.speed_m_s  # refused as without an expression
    assert replace(paint_context(), max_speed_m_s=0.065).about("", VIVID).tool.speed_m_s == 0.065
    in_hands = replace(paint_context(), hands={"anna": paint_context()}).about("", VIVID)
    assert in_hands.in_hand("anna").tool == in_hands.tool != paint_context().tool


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan")])
@pytest.mark.parametrize("name", ["chroma", "length", "tempo"])
def test_factors_are_above_zero(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        replace(PLAIN, **{name: value})


def speeds_m_s(folder: Path) -> list[float]:
    """Highest commanded speed of each recorded stroke that is long enough to reach the tool's."""
    found = []
    for row in read_table(folder / RECORD, CONTRACT).table.to_pylist():
        path = np.array(row["path"], float).reshape(-1, 5)
        steps = np.linalg.norm(np.diff(path[:, 1:3], axis=0), axis=1)
        if steps.sum() > 0.01:
            found.append(float((steps / np.diff(path[:, 0])).max()))
    return found


def test_a_wish_is_painted_as_it_was_said_also_after_it_was_stopped_and_then_a_typed_one_as_ever(
    tmp_path: Path,
) -> None:
    def bar(canvas: np.ndarray, _words: str) -> Proposal:
        goal = canvas.copy()
        goal[10:-10, -11:-8] = (40, 40, 120)
        return Proposal([goal])

    robot, control = journaled_sheet(tmp_path), Control()
    begun(robot, tmp_path)
    control.send("wish", "a bar", VIVID)

    def person(state) -> None:
        if state.executed == 2 and state.turns == 1:
            control.send("stop")

    stopped = resume(session_of(robot, tmp_path, control, person, goals_for=bar))
    robot.close()
    assert stopped.phase == "stopped" and expression_in(tmp_path) == VIVID == read_turns(tmp_path)[-1].expression
    shown = read_image(tmp_path / "turns" / "001_goal.png")
    assert (stopped.goal == shown).all()
    given = srgb_to_lab(to_float(np.uint8([[[40, 40, 120]]])))[0, 0]
    painted = srgb_to_lab(to_float(shown[20:21, -10:-9]))[0, 0]
    assert painted[0] == pytest.approx(given[0] + VIVID.lightness, abs=1.0)
    assert np.hypot(*painted[1:]) == pytest.approx(VIVID.chroma * np.hypot(*given[1:]), abs=3.0)
    again = journaled_sheet(tmp_path)
    resume(session_of(again, tmp_path, goals_for=bar))
    again.close()
    fast, usual = VIVID.tempo * paint_context().tool.speed_m_s, paint_context().tool.speed_m_s
    made = speeds_m_s(tmp_path)
    assert len(made) > 2 and max(made) == pytest.approx(fast, rel=0.02) and min(made) > 0.8 * fast
    once_more = journaled_sheet(tmp_path)
    resume(session_of(once_more, tmp_path, goals_for=bar), "a bar")
    assert expression_in(tmp_path) == PLAIN
    assert max(speeds_m_s(tmp_path)[len(made) :], default=usual) == pytest.approx(usual, rel=0.02)


def test_strokes_of_a_plan_are_at_least_as_long_as_the_expression_says(tmp_path: Path) -> None:
    robot, control = sheet(), Control()
    begun(robot, tmp_path)
    control.send("wish", "a bar", VIVID)

    def bar(canvas: np.ndarray, _words: str) -> Proposal:
        goal = canvas.copy()
        goal[10:-10, -11:-8] = 40
        return Proposal([goal])

    lengths: list[float] = []
    resume(session_of(robot, tmp_path, control, lambda state: lengths.extend(
        state.remaining.length_m if state.turns == 1 and state.phase == "painting" and expression_in(tmp_path) == VIVID
        and state.message.startswith("Stroke") else []), goals_for=bar))  # fmt: skip
    assert lengths and min(lengths) >= 1.5 * paint_context().tool.stroke_length_m[0] * 0.999
