"""Scores of perfect, copied and blank completions in closed form, and the layout of the guidance grid."""

from dataclasses import replace

import numpy as np
import pytest

from pentimento.copainting.goal.completions import Sampling, guidance_grid, score_completions, score_planner
from tests.copainting.goal_planners import SIDE_PX, small_pairs, small_planner

SAMPLING = Sampling(steps=2, image_guidance=(1.0, 1.5), text_guidance=(1.0, 2.0), shown=2, scored=3, enlarged=2, seed=0)


def drawn(rows: list[int]) -> np.ndarray:
    picture = np.full((1, 20, 20, 3), 255, np.uint8)
    picture[:, rows, 5:15] = 0
    return picture


def test_scores_of_perfect_copied_and_blank_completions() -> None:
    partial, full = drawn([4]), drawn([4, 12])
    copying = 10 / 400  # of the pixels, black for white
    perfect = score_completions(partial, full, full)
    assert (perfect.mse, perfect.kept) == (0.0, 1.0)
    assert perfect.mse_of_copying == pytest.approx(copying)
    assert score_completions(partial, partial, full).mse == pytest.approx(copying)
    blank = score_completions(partial, drawn([]), full)
    assert (blank.mse, blank.kept) == (pytest.approx(2 * copying), 0.0)
    assert score_completions(drawn([]), full, full).kept is None


def test_scores_at_most_the_configured_number_of_pairs() -> None:
    planner, pairs = small_planner(), small_pairs(5)
    assert score_planner(planner, pairs, SAMPLING).pairs == 3
    assert score_planner(planner, pairs[:2], SAMPLING).pairs == 2


def test_guidance_grid_shows_inputs_targets_and_each_combination() -> None:
    pairs = small_pairs(2)
    grid = guidance_grid(small_planner(), pairs, SAMPLING)
    large, head, gap = 2 * SIDE_PX, 26, 4
    assert grid.shape == (head + 2 * (large + head), 6 * (large + gap), 3)
    for row, pair in enumerate(pairs):
        top = head + row * (large + head) + head
        for column, picture in enumerate((pair.input, pair.target)):
            left = column * (large + gap)
            assert (grid[top : top + large : 2, left : left + large : 2] == picture).all()


def test_rejects_guidance_below_one() -> None:
    with pytest.raises(ValueError, match=r"image_guidance is \[0.5\]; give values of 1 or more"):
        replace(SAMPLING, image_guidance=(0.5,))
