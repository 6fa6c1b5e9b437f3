"""Plans for goal pictures: nearer to the goal, on what is there, with no stroke that does harm."""

from dataclasses import replace

import numpy as np
import pytest
import torch

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
from pentimento.robots.tools import load_tool
from tests.copainting.easels import MEDIUM, SIDE_PX, cross, marker_paint_context, paper


@pytest.fixture(autouse=True)
def one_thread() -> None:
    torch.set_num_threads(1)


def test_a_plan_comes_near_its_goal_and_keeps_what_is_there() -> None:
    paint_context, goal = marker_paint_context(), cross()
    sheet = as_sheet(paper(), MEDIUM.side_px)
    made = plan_goal(paint_context, sheet, goal, 24)
    before, after = (delta_pix(goal[None], p[None])[0] for p in (paper(), as_picture(made.sheet, SIDE_PX)))
    assert after < 0.4 * before and 1 <= len(made.strokes) <= 24
    twice = draw_scene(paint_context, made.sheet, np.rot90(goal[:, :16].repeat(2, 1)).copy(), 8)
    assert surviving_ink(as_picture(made.sheet, SIDE_PX)[None], as_picture(twice.sheet, SIDE_PX)[None])[0] == 1
    assert (twice.sheet <= made.sheet + 1e-4).all()  # a black pen never lightens


def test_a_goal_that_is_there_needs_no_stroke() -> None:
    sheet = as_sheet(cross(), MEDIUM.side_px)
    made = plan_goal(marker_paint_context(), sheet, as_picture(sheet, SIDE_PX), 12)
    assert len(made.strokes) == 0 and np.array_equal(made.sheet, sheet)


def test_no_stroke_is_left_that_does_harm() -> None:
    """On a blank goal, every stroke would."""
    paint_context, sheet = marker_paint_context(), as_sheet(cross(), MEDIUM.side_px)
    grey = np.full_like(paper(), 245)
    assert len(plan_goal(paint_context, sheet, grey, 12).strokes) == 0  # a pen cannot lighten what is there


def test_equal_seeds_give_equal_plans_and_others_others() -> None:
    sheet = as_sheet(paper(), MEDIUM.side_px)
    one, again, other = (plan_goal(seeded(marker_paint_context(), s), sheet, cross(), 8).sheet for s in (1, 1, 2))
    assert np.array_equal(one, again) and not np.array_equal(one, other)


def test_pictures_come_back_from_the_sheet() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (SIDE_PX, SIDE_PX, 3)).astype(np.uint8)
    assert np.array_equal(as_picture(as_sheet(noise, SIDE_PX), SIDE_PX), noise)
    flat = np.full((8, 8, 3), 130, np.uint8)
    assert (as_picture(as_sheet(flat, 48), 16) == 130).all()


def test_a_medium_fits_its_tool() -> None:
    with pytest.raises(ConfigError, match="brings none: null it"):
        PaintContext(MEDIUM, load_tool("round_brush"), marker_paint_context().model)
    with pytest.raises(ConfigError, match="say under ink"):
        PaintContext(replace(MEDIUM, ink=None), load_tool("marker"), marker_paint_context().model)
    with pytest.raises(ValueError, match="side_m"):
        replace(MEDIUM, side_m=0.0)
