"""Plans for goal pictures: a lower error, existing ink is kept, and no harmful stroke."""

from dataclasses import replace

import numpy as np
import pytest

from pentimento.contracts.errors import ConfigError
from pentimento.copainting.evaluation.goal_plans import (
    PaintContext,
    as_picture,
    as_sheet,
    draw_scene,
    plan_goal,
    seeded,
)
from pentimento.copainting.evaluation.scoring import delta_pix, surviving_ink
from pentimento.dynamics.strokes.extended import base_model
from pentimento.planning.strokes.palette import PaletteChoice
from pentimento.robots.tools import load_tool
from tests.copainting.media import MEDIUM, PARAMETERS, SIDE_PX, cross, marker_paint_context, paper


def test_goal_plan_lowers_the_error_and_keeps_existing_ink() -> None:
    paint_context, goal = marker_paint_context(), cross()
    sheet = as_sheet(paper(), MEDIUM.side_px)
    result = plan_goal(paint_context, sheet, goal, 24)
    before, after = (delta_pix(goal[None], p[None])[0] for p in (paper(), as_picture(result.sheet, SIDE_PX)))
    assert after < 0.4 * before and 1 <= len(result.strokes) <= 24
    twice = draw_scene(paint_context, result.sheet, np.rot90(goal[:, :16].repeat(2, 1)).copy(), 8)
    assert surviving_ink(as_picture(result.sheet, SIDE_PX)[None], as_picture(twice.sheet, SIDE_PX)[None])[0] == 1
    assert (twice.sheet <= result.sheet + 1e-4).all()  # a black pen never lightens


def test_paints_leave_what_is_on_the_sheet_where_the_picture_shows_its_ground() -> None:
    planner = replace(
        MEDIUM.planner, iterations_palette=2, palette=PaletteChoice("plan", 2, None, None),
        learning_rates=replace(MEDIUM.planner.learning_rates, color=0.05),
    )  # fmt: skip
    brush = PaintContext(
        replace(MEDIUM, tool="round_brush", ink=None, planner=planner), load_tool("round_brush"),
        base_model(PARAMETERS),
    )  # fmt: skip
    shown = paper()
    shown[4:10] = (60, 90, 200)  # on the sheet already
    picture = np.full_like(shown, 235)  # another ground
    picture[20:28, 6:26] = (200, 40, 40)
    after = as_picture(draw_scene(brush, as_sheet(shown, MEDIUM.side_px), picture, 16).sheet, SIDE_PX)
    assert np.abs(after[5:9].astype(int) - shown[5:9]).mean() < 12
    assert after[23:26, 12:20, 1].mean() < 150 and after[23:26, 12:20, 0].mean() > 150


def test_goal_equal_to_the_sheet_needs_no_stroke() -> None:
    sheet = as_sheet(cross(), MEDIUM.side_px)
    result = plan_goal(marker_paint_context(), sheet, as_picture(sheet, SIDE_PX), 12)
    assert len(result.strokes) == 0 and np.array_equal(result.sheet, sheet)


def test_goal_plan_has_no_harmful_stroke() -> None:
    """On a blank goal, every stroke would."""
    paint_context, sheet = marker_paint_context(), as_sheet(cross(), MEDIUM.side_px)
    grey = np.full_like(paper(), 245)
    assert len(plan_goal(paint_context, sheet, grey, 12).strokes) == 0  # a pen cannot lighten what is there


def test_goal_plan_depends_on_the_seed() -> None:
    sheet = as_sheet(paper(), MEDIUM.side_px)
    one, again, other = (plan_goal(seeded(marker_paint_context(), s), sheet, cross(), 8).sheet for s in (1, 1, 2))
    assert np.array_equal(one, again) and not np.array_equal(one, other)


def test_picture_converts_to_a_sheet_and_back() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (SIDE_PX, SIDE_PX, 3)).astype(np.uint8)
    assert np.array_equal(as_picture(as_sheet(noise, SIDE_PX), SIDE_PX), noise)
    flat = np.full((8, 8, 3), 130, np.uint8)
    assert (as_picture(as_sheet(flat, 48), 16) == 130).all()


def test_rejects_medium_that_does_not_fit_its_tool() -> None:
    with pytest.raises(ConfigError, match="has none: set ink to null"):
        PaintContext(MEDIUM, load_tool("round_brush"), marker_paint_context().model)
    with pytest.raises(ValueError, match="side_m"):
        replace(MEDIUM, side_m=0.0)
