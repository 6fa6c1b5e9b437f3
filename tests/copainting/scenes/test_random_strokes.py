"""Random strokes: dark on light, wider pens ink more, and equal seeds draw the same."""

import numpy as np

from pentimento.copainting.scenes.random_strokes import random_strokes


def drawn(strokes: int, width: float, seed: int) -> np.ndarray:
    return random_strokes(48, strokes, (width, width), np.random.default_rng(seed))


def inked(picture: np.ndarray) -> float:
    return float((picture.max() - picture.astype(float)).mean() / (picture.max() - picture.min() + 1e-9))


def test_more_and_wider_strokes_leave_more_ink() -> None:
    for seed in range(5):
        assert inked(drawn(20, 2, seed)) > 2 * inked(drawn(3, 2, seed)) > 0
        assert inked(drawn(8, 4, seed)) > 1.5 * inked(drawn(8, 1.5, seed))


def test_strokes_are_darker_than_their_paper_and_repeatable() -> None:
    for seed in range(12):
        picture = drawn(10, 2.5, seed)
        assert (picture == drawn(10, 2.5, seed)).all()
        assert picture.max() >= 220 and np.median(picture) > 200
    assert (drawn(10, 2.5, 0) != drawn(10, 2.5, 1)).any()
