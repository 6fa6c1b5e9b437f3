"""Naming by the likelihood of pixels: BIC on a linear model has a closed form."""

import numpy as np
import pytest

from studies.blind.pixelwise import select


def sums(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    return x.T @ x, x.T @ y, float(y @ y)


@pytest.fixture(scope="module")
def pixels() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    x = rng.standard_normal((4000, 5))  # the base's, and four candidates'
    return x, x[:, 0] + 0.3 * x[:, 2] + rng.standard_normal(4000)


COLUMNS = {name: np.array([k]) for k, name in enumerate("abcd", 1)}


def test_the_true_candidate_alone_is_named(pixels: tuple[np.ndarray, np.ndarray]) -> None:
    x, y = pixels
    assert select(*sums(x, y), np.array([0]), COLUMNS, len(y)) == ("b",)


def test_nothing_is_named_where_the_base_is_all(pixels: tuple[np.ndarray, np.ndarray]) -> None:
    x, y = pixels
    assert select(*sums(x, y - 0.3 * x[:, 2]), np.array([0]), COLUMNS, len(y)) == ()


def test_errors_that_strokes_share_are_taken_for_causes() -> None:
    """Why the action is the unit: 40 strokes of 500 pixels that err together, and candidates by stroke."""
    rng = np.random.default_rng(1)
    named = 0
    for _ in range(20):
        by_stroke = np.repeat(rng.standard_normal((40, 5)), 500, axis=0)
        y = np.repeat(rng.standard_normal(40), 500) + rng.standard_normal(20_000)
        named += len(select(*sums(by_stroke, y), np.array([0]), COLUMNS, len(y)))
    assert named > 40  # of 80, none of them there
