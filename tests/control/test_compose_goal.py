"""What is left as it is stays the canvas to the pixel; what is drawn, or painted over, is the completion's."""

import cv2
import numpy as np
import pytest

from pentimento.control.goal import keep_canvas

SIDE, PLACE_PX = 48, 4.0


def _canvas() -> np.ndarray:
    """A ring in ink on grained paper, uint8 [1, S, S, 3]."""
    paper = np.random.default_rng(0).integers(235, 250, (SIDE, SIDE, 3)).astype(np.uint8)
    return cv2.circle(paper, (16, 16), 9, (25, 25, 25), 2, cv2.LINE_AA)[None]


def _again(canvas: np.ndarray) -> np.ndarray:
    """As an autoencoder might know it: softer, without the grain, a little too dark."""
    softer = np.stack([cv2.GaussianBlur(picture, (0, 0), 0.7) for picture in canvas])
    return np.round(0.97 * softer).astype(np.uint8)


def test_what_comes_back_as_the_autoencoder_knows_it_is_the_canvas() -> None:
    canvas = _canvas()
    assert np.array_equal(keep_canvas(canvas, _again(canvas), _again(canvas), PLACE_PX), canvas)


def test_a_line_that_is_redrawn_nearly_as_it_was_is_the_canvas() -> None:
    canvas = _canvas()
    noise = np.random.default_rng(1).normal(0, 4, canvas.shape)
    made = np.clip(_again(canvas) + noise, 0, 255).astype(np.uint8)
    assert np.array_equal(keep_canvas(canvas, made, _again(canvas), PLACE_PX), canvas)


def test_a_new_line_is_the_completions_and_the_old_ones_are_the_canvas() -> None:
    canvas = _canvas()
    made = _again(canvas)
    made[0, 30:46, 34:37] = 25
    goal = keep_canvas(canvas, made, _again(canvas), PLACE_PX)
    assert np.array_equal(goal[0, 31:45, 34:37], made[0, 31:45, 34:37])
    assert np.array_equal(goal[0, :26], canvas[0, :26]) and np.array_equal(goal[0, :, :30], canvas[0, :, :30])


@pytest.mark.parametrize("level", [120, 245])
def test_paint_may_cover_what_was_there(level: int) -> None:
    """Also with the paper's own white."""
    canvas = _canvas()
    made = _again(canvas)
    made[0, 4:28, 4:28] = level
    goal = keep_canvas(canvas, made, _again(canvas), PLACE_PX)
    inked = canvas[0].max(-1) < 60
    assert inked.any() and np.all(goal[0][inked] == level)


def test_each_picture_is_its_own() -> None:
    canvas = np.concatenate([_canvas(), 255 - _canvas()])
    made = _again(canvas)[::-1]
    both = keep_canvas(canvas, made, _again(canvas), PLACE_PX)
    one = keep_canvas(canvas[1:], made[1:], _again(canvas)[1:], PLACE_PX)
    assert np.array_equal(both[1:], one)
