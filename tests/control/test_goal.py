"""Goals: a picture fitted to canvas and tool, and what words make of a canvas, with plain functions for networks."""

import numpy as np
import pytest

from pentimento.bundle.sampler import Networks, NoiseSchedule
from pentimento.bundle.tokenizer import END, START, Tokenizer
from pentimento.control.goal import GoalSampling, goal_from_picture, goal_from_words
from pentimento.robots.tools import load_tool

SIDE, STEP = 32, 8
SCHEDULE = NoiseSchedule(np.linspace(0.999, 0.0, 50, dtype=np.float32), 1.0, "sample", "trailing")
LETTERS = {letter + "</w>": number for number, letter in enumerate("abcdefghijklmnopqrstuvwxyz")}
WORDS = Tokenizer({START: 100, END: 101, **LETTERS}, {}, 4)


def _canvas(height: int, width: int) -> np.ndarray:
    return np.random.default_rng(0).integers(180, 240, (height, width, 3), dtype=np.uint8)


def _networks(answers: np.ndarray | None) -> Networks:
    """Latents are pictures averaged over squares; the network predicts ``answers``, or the canvas as it sees it."""
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


def _asked(canvas: np.ndarray, answers: np.ndarray | None) -> np.ndarray:
    return goal_from_words(
        "a b", canvas, _networks(answers), schedule=SCHEDULE, tokenizer=WORDS, sampling=_sampling(1.0, 3)
    )


def test_a_picture_is_cut_to_the_canvas_and_to_the_tones_of_a_pen() -> None:
    picture = np.zeros((60, 200, 3), np.uint8)
    picture[:, 70:130] = np.linspace(0, 255, 60, dtype=np.uint8)[None, :, None]
    picture[:, :40, 0] = 255  # beside the centre: cut off
    canvas = np.full((50, 50, 3), 240, np.uint8)
    pen = goal_from_picture(picture, canvas, load_tool("marker"))
    assert pen.shape == canvas.shape
    assert np.ptp(pen, axis=2).max() == 0  # a pen has no colours
    assert 80 <= pen.min() <= 100 and pen.max() == 240  # from the darkest tone asked for to the paper
    brush = goal_from_picture(picture, canvas, load_tool("round_brush"))
    assert brush.min() < 10 and brush.max() > 245


def test_what_is_drawn_already_stays_part_of_a_pens_goal() -> None:
    canvas = np.full((40, 40, 3), 235, np.uint8)
    canvas[10:14] = 20
    goal = goal_from_picture(np.full((40, 40, 3), 255, np.uint8), canvas, load_tool("marker"))
    assert np.array_equal(goal, canvas)


def test_words_make_a_goal_of_the_canvas_that_the_networks_saw() -> None:
    canvas = np.full((SIDE, SIDE, 3), 200, np.uint8)
    assert np.abs(_asked(canvas, None).astype(int) - 200).max() <= 1  # the canvas as it was seen


def test_only_the_centred_square_of_a_wide_canvas_is_completed() -> None:
    canvas = _canvas(48, 80)
    goal = _asked(canvas, np.full((1, 3, 1, 1), -0.5, np.float32))
    assert np.array_equal(goal[:, :16], canvas[:, :16]) and np.array_equal(goal[:, 64:], canvas[:, 64:])
    assert np.all(goal[:, 16:64] == 64)  # (−0.5 + 1) / 2 of 255, rounded to even


def test_what_is_left_of_a_large_canvas_is_not_resized() -> None:
    """Only the place that the networks darkened, from pixel 48 on, and less than a place about it, is drawn anew."""
    canvas = np.full((64, 64, 3), 200, np.uint8)
    canvas[5::8] = 190  # finer than the networks see
    answers = np.full((1, 3, SIDE // STEP, SIDE // STEP), 197.5 / 127.5 - 1, np.float32)
    answers[..., 3, 3] = -1
    goal = _asked(canvas, answers)
    assert np.array_equal(goal[:32, :32], canvas[:32, :32]) and goal[52:, 52:].max() == 0


def test_a_goal_that_changes_nothing_is_the_canvas_itself() -> None:
    canvas = _canvas(SIDE, SIDE)
    canvas[:] = 100
    assert np.array_equal(_asked(canvas, np.full((1, 3, 1, 1), 100 / 127.5 - 1, np.float32)), canvas)


@pytest.mark.parametrize("guidance", [1.0, 6.0])
def test_the_seed_is_the_goals(guidance: float) -> None:
    def networks() -> Networks:
        known = _networks(None)
        return Networks(known.read, known.encode, lambda z, _t, _x: 0.5 * z[:, :3], known.decode, 1.0)

    canvas = _canvas(SIDE, SIDE)
    made = [
        goal_from_words("a", canvas, networks(), schedule=SCHEDULE, tokenizer=WORDS, sampling=_sampling(guidance, seed))
        for seed in (1, 1, 2)
    ]
    assert np.array_equal(made[0], made[1]) and not np.array_equal(made[0], made[2])
