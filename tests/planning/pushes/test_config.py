"""Actions are kept within what an end-effector can do and where it can go."""

import numpy as np
import pytest

from pentimento.planning.pushes.config import Reach, ends
from tests.planning.pushes.settings import REACH


def inside(points_m: np.ndarray) -> bool:
    x_min, y_min, x_max, y_max = REACH.window_m
    return bool(
        (points_m >= np.array([x_min, y_min]) - 1e-12).all() and (points_m <= np.array([x_max, y_max]) + 1e-12).all()
    )


def test_keep_within_moves_any_action_into_reach() -> None:
    wild = np.random.default_rng(0).normal(0, 1, (500, 5))
    kept = REACH.keep_within(wild)
    assert inside(kept[:, :2]) and inside(ends(kept))
    assert kept[:, 3].min() >= REACH.length_m[0] and kept[:, 3].max() <= REACH.length_m[1]
    assert kept[:, 4].min() >= REACH.depth_m[0] and kept[:, 4].max() <= REACH.depth_m[1]


def test_keep_within_keeps_allowed_actions() -> None:
    drawn = REACH.draw(200, np.random.default_rng(1))
    np.testing.assert_allclose(REACH.keep_within(drawn), drawn, atol=1e-12)


def test_keep_within_translates_pushes_at_the_edge() -> None:
    push = np.array([[0.085, 0.05, 0.0, 0.02, 0.004]])
    np.testing.assert_allclose(REACH.keep_within(push), [[0.07, 0.05, 0.0, 0.02, 0.004]], atol=1e-12)


def test_keep_within_wraps_headings() -> None:
    push = np.array([[0.05, 0.05, 3.5 * np.pi, 0.02, 0.004]])
    assert REACH.keep_within(push)[0, 2] == pytest.approx(-0.5 * np.pi)


def test_keep_within_allows_a_pinch_at_the_edge() -> None:
    pinch = Reach(REACH.window_m, (0.01, 0.03), REACH.depth_m, 0.012, travels=False)
    at_edge = np.array([[0.09, 0.05, 0.0, 0.02, 0.004]])
    np.testing.assert_allclose(pinch.keep_within(at_edge), at_edge, atol=1e-12)


def test_reach_rejects_invalid_ranges() -> None:
    with pytest.raises(ValueError, match=r"depth_m is 0\.008 to 0\.001"):
        Reach(REACH.window_m, (0.0, 0.01), (0.008, 0.001), 0.01, True)
    with pytest.raises(ValueError, match="do not fit"):
        Reach((0, 0, 0.01, 0.01), (0.0, 0.05), (0.0, 0.001), 0.01, True)
