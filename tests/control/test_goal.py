"""Goals: a picture fitted to canvas and tool, and completions of a canvas by plain functions as networks."""

import cv2
import numpy as np
import pytest

from pentimento.bundle.sampler import Networks, NoiseSchedule
from pentimento.bundle.tokenizer import END, START, Tokenizer
from pentimento.control.goal import GoalSampling, goal_from_picture, goal_from_words, keep_canvas
from pentimento.control.layout import WHOLE, Wish
from pentimento.robots.tools import load_tool

SIDE, STEP = 32, 8
SCHEDULE = NoiseSchedule(np.linspace(0.999, 0.0, 50, dtype=np.float32), 1.0, "sample", "trailing")
LETTERS = {letter + "</w>": number for number, letter in enumerate("abcdefghijklmnopqrstuvwxyz")}
WORDS = Tokenizer({START: 100, END: 101, **LETTERS}, {}, 4)


def _canvas(height: int, width: int) -> np.ndarray:
    canvas = np.random.default_rng(0).integers(180, 240, (height, width, 3), dtype=np.uint8)
    canvas[::3] = 250  # white paper
    return canvas


def _networks(answers: np.ndarray | None) -> Networks:
    """Latents are pictures averaged over squares; the network predicts ``answers``, or returns the canvas."""
    return Networks(
        read=lambda tokens: tokens[..., None].astype(np.float32),
        encode=lambda picture: picture.reshape(len(picture), 3, SIDE // STEP, STEP, SIDE // STEP, STEP).mean((3, 5)),
        predict=lambda latents, _t, _text: (
            latents[:, 3:] if answers is None else np.broadcast_to(answers, latents[:, 3:].shape)
        ).astype(np.float32),
        decode=lambda latents: latents.repeat(STEP, 2).repeat(STEP, 3),
        scaling=1.0,
    )


def _sampling(text_guidance: float, seed: int) -> GoalSampling:
    return GoalSampling(SIDE, 3, STEP, 4, 1.0, text_guidance, seed)


def _completed(canvas: np.ndarray, answers: np.ndarray | None) -> np.ndarray:
    return goal_from_words(
        [Wish("a b", WHOLE)],
        canvas,
        _networks(answers),
        has_ink=False,
        schedule=SCHEDULE,
        tokenizer=WORDS,
        sampling=_sampling(1.0, 3),
    )


def test_goal_from_picture_is_cropped_and_fitted_to_pen_tones() -> None:
    picture = np.zeros((60, 200, 3), np.uint8)
    picture[:, 70:130] = np.linspace(0, 255, 60, dtype=np.uint8)[None, :, None]
    picture[:, :40, 0] = 255  # outside the centre: cropped
    canvas = np.full((50, 50, 3), 240, np.uint8)
    pen = goal_from_picture(picture, canvas, load_tool("marker"))
    assert pen.shape == canvas.shape
    assert np.ptp(pen, axis=2).max() == 0  # a pen has no colours
    assert 80 <= pen.min() <= 100 and pen.max() == 240  # from the darkest tone of a pen to the paper
    brush = goal_from_picture(picture, canvas, load_tool("round_brush"))
    assert brush.min() < 10 and brush.max() > 245


def test_goal_from_picture_keeps_ink_on_the_canvas() -> None:
    canvas = np.full((40, 40, 3), 235, np.uint8)
    canvas[10:14] = 20
    goal = goal_from_picture(np.full((40, 40, 3), 255, np.uint8), canvas, load_tool("marker"))
    assert np.array_equal(goal, canvas)


def test_goal_from_words_starts_from_the_canvas() -> None:
    canvas = np.full((SIDE, SIDE, 3), 200, np.uint8)
    assert np.abs(_completed(canvas, None).astype(int) - 200).max() <= 1


def test_goal_from_words_completes_the_centred_square() -> None:
    canvas = _canvas(48, 80)
    goal = _completed(canvas, np.full((1, 3, 1, 1), -0.5, np.float32))
    assert np.array_equal(goal[:, :16], canvas[:, :16]) and np.array_equal(goal[:, 64:], canvas[:, 64:])
    assert np.all(goal[:, 16:64] == 64)  # (−0.5 + 1) / 2 of 255, rounded to even


def test_goal_from_words_does_not_resize_unchanged_parts() -> None:
    """Only the cell that the networks darkened, from pixel 48 on, and its rim change."""
    canvas = np.full((64, 64, 3), 250, np.uint8)
    canvas[5::8] = 240  # finer than a latent cell
    answers = np.full((1, 3, SIDE // STEP, SIDE // STEP), 247.5 / 127.5 - 1, np.float32)
    answers[..., 3, 3] = -1
    goal = _completed(canvas, answers)
    assert np.array_equal(goal[:32, :32], canvas[:32, :32]) and goal[52:, 52:].max() == 0


def test_goal_from_words_without_change_is_the_canvas() -> None:
    canvas = _canvas(SIDE, SIDE)
    canvas[:] = 100
    assert np.array_equal(_completed(canvas, np.full((1, 3, 1, 1), 100 / 127.5 - 1, np.float32)), canvas)


@pytest.mark.parametrize("guidance", [1.0, 6.0])
def test_goal_from_words_depends_on_the_seed_only(guidance: float) -> None:
    def networks() -> Networks:
        known = _networks(None)
        return Networks(known.read, known.encode, lambda z, _t, _x: 0.5 * z[:, :3], known.decode, 1.0)

    canvas = _canvas(SIDE, SIDE)
    goals = [
        goal_from_words(
            [Wish("a", WHOLE)],
            canvas,
            networks(),
            has_ink=False,
            schedule=SCHEDULE,
            tokenizer=WORDS,
            sampling=_sampling(guidance, seed),
        )
        for seed in (1, 1, 2)
    ]
    assert np.array_equal(goals[0], goals[1]) and not np.array_equal(goals[0], goals[2])


RING_PX, CELL_PX = 48, 4.0


def _ring() -> np.ndarray:
    """A ring in ink on grained paper, uint8 [1, S, S, 3]."""
    paper = np.random.default_rng(0).integers(235, 250, (RING_PX, RING_PX, 3)).astype(np.uint8)
    return cv2.circle(paper, (16, 16), 9, (25, 25, 25), 2, cv2.LINE_AA)[None]


def _reconstruction(canvas: np.ndarray) -> np.ndarray:
    """A typical reconstruction: softer, without the grain, slightly too dark."""
    softer = np.stack([cv2.GaussianBlur(picture, (0, 0), 0.7) for picture in canvas])
    return np.round(0.97 * softer).astype(np.uint8)


def test_keep_canvas_returns_the_canvas_for_its_reconstruction() -> None:
    canvas = _ring()
    assert np.array_equal(keep_canvas(canvas, _reconstruction(canvas), _reconstruction(canvas), CELL_PX), canvas)


def test_keep_canvas_ignores_small_differences() -> None:
    canvas = _ring()
    noise = np.random.default_rng(1).normal(0, 4, canvas.shape)
    completion = np.clip(_reconstruction(canvas) + noise, 0, 255).astype(np.uint8)
    assert np.array_equal(keep_canvas(canvas, completion, _reconstruction(canvas), CELL_PX), canvas)


def test_keep_canvas_takes_a_new_line_and_keeps_old_ones() -> None:
    canvas = _ring()
    completion = _reconstruction(canvas)
    completion[0, 30:46, 34:37] = 25
    goal = keep_canvas(canvas, completion, _reconstruction(canvas), CELL_PX)
    assert np.array_equal(goal[0, 31:45, 34:37], completion[0, 31:45, 34:37])
    assert np.array_equal(goal[0, :26], canvas[0, :26]) and np.array_equal(goal[0, :, :30], canvas[0, :, :30])


@pytest.mark.parametrize("level", [120, 245])
def test_keep_canvas_takes_paint_that_covers_the_canvas(level: int) -> None:
    """Also with the white of the paper."""
    canvas = _ring()
    completion = _reconstruction(canvas)
    completion[0, 4:28, 4:28] = level
    goal = keep_canvas(canvas, completion, _reconstruction(canvas), CELL_PX)
    inked = canvas[0].max(-1) < 60
    assert inked.any() and np.all(goal[0][inked] == level)


def test_keep_canvas_treats_pictures_of_a_batch_independently() -> None:
    canvas = np.concatenate([_ring(), 255 - _ring()])
    completion = _reconstruction(canvas)[::-1]
    both = keep_canvas(canvas, completion, _reconstruction(canvas), CELL_PX)
    one = keep_canvas(canvas[1:], completion[1:], _reconstruction(canvas)[1:], CELL_PX)
    assert np.array_equal(both[1:], one)
