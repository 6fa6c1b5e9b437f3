"""Numbers of turns that are known beforehand."""

import numpy as np
import pytest
import torch

from pentimento.copainting.evaluation.codraw import Turn
from pentimento.copainting.evaluation.played_turns import film_strip, turn_scores
from tests.copainting.easels import cross, paper
from tests.copainting.goal_planners import small_encoder


def turn(before: np.ndarray, after: np.ndarray, strokes: int) -> Turn:
    return Turn("a red disc", paper(), before, before, after, after, (1, strokes))


def test_ink_that_stays_and_ink_that_goes() -> None:
    torch.set_num_threads(1)
    kept, lost = turn(cross(), cross(), 0), turn(cross(), paper(), 4)
    scores = turn_scores([[kept, kept], [kept, lost]], small_encoder())
    assert scores[0]["drawing_keeps"] == 1 and scores[0]["changed"] == 0 and scores[0]["strokes"] == 0
    assert scores[0]["judge_score"] == pytest.approx(scores[0]["judge_score_no_change"])
    assert scores[1]["drawing_keeps"] == 0.5 and scores[1]["strokes"] == 2
    share = (cross() != paper()).any(-1).mean() / 2
    assert scores[1]["changed"] == pytest.approx(share)


def test_no_ink_no_share() -> None:
    assert turn_scores([[turn(paper(), cross(), 3)]], small_encoder())[0]["drawing_keeps"] is None


def test_a_strip_has_a_picture_for_each_turn() -> None:
    strip = film_strip([turn(paper(), cross(), 1), turn(cross(), cross(), 0)])
    assert all(len(pictures) == 2 for pictures in strip.values())
    assert (strip["robot adds"][0] == cross()).all() and (strip["person draws"][0] == paper()).all()
