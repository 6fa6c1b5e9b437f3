"""Closed forms and derivatives of the soft-edge footprint."""

import numpy as np
import pytest
from scipy.stats import norm

from pentimento.diagnosis.strokes.soft_edge import LEVELS, change_of_coverage, footprint_of

SHAPE = (48, 64)
PLAIN = np.eye(len(LEVELS))[0]


def stroke(radius: float = 4.0, edge: float = 0.8, bend: float = 0.0, shift: float = 0.0) -> np.ndarray:
    t = np.linspace(0, 1, 24)
    column, row = 12 + 36 * t + shift, 24 + bend * np.sin(np.pi * t)
    return np.stack([column, row, np.full(24, radius), np.full(24, 0.9), np.full(24, edge)], axis=-1)[None]


@pytest.mark.parametrize("edge", [0.5, 1.5])
def test_profile_of_a_straight_stroke_is_the_convolved_slab(edge: float) -> None:
    coverage = footprint_of(stroke(edge=edge), PLAIN, SHAPE).coverage[0, :, 30]
    distance = np.abs(np.arange(SHAPE[0]) - 24)
    expected = 0.9 * (norm.cdf((4 - distance) / edge) - norm.cdf((-4 - distance) / edge))
    np.testing.assert_allclose(coverage, expected, atol=1e-4)
    near = np.abs(distance - 4) < 3 * edge  # farther out, it ends at the footprint's reach
    np.testing.assert_allclose(coverage[near], expected[near], atol=3e-7)


def test_blur_and_subpixel_shift_conserve_ink() -> None:
    """Pointwise sampling would violate this by its sawtooth errors."""
    area = 0.9 * (2 * 4 * 36 + np.pi * 4**2)
    for edge, shift in [(0.4, 0.0), (0.4, 0.5), (1.2, 0.0)]:
        assert footprint_of(stroke(edge=edge, shift=shift), PLAIN, SHAPE).coverage.sum() == pytest.approx(
            area, rel=0.02
        )


def test_shift_by_whole_pixels_shifts_the_footprint() -> None:
    here, there = (footprint_of(stroke(bend=6, shift=s), PLAIN, SHAPE).coverage for s in (0.0, 5.0))
    np.testing.assert_allclose(there[:, :, 5:], here[:, :, :-5], atol=1e-6)


@pytest.mark.parametrize("field", range(5), ids=["column", "row", "radius", "density", "edge"])
def test_derivatives_by_the_mark_equal_differences(field: int) -> None:
    weights = np.array([0.6, 0.1, 0.1, 0.1, 0.05, 0.05])
    mark, change = stroke(bend=6), np.zeros((1, 1, 24, 5))
    change[..., field] = np.cos(np.linspace(0, 2, 24))
    step = 1e-3
    up, down = (footprint_of(mark + sign * step * change[0], weights, SHAPE).coverage for sign in (1, -1))
    numeric = (up - down) / (2 * step)
    footprint = footprint_of(mark, weights, SHAPE)
    reached = np.flatnonzero(footprint.segment >= 0)
    exact = change_of_coverage(footprint, change, reached)[:, 0]
    assert np.linalg.norm(exact - numeric.ravel()[reached]) < 0.03 * np.linalg.norm(numeric)


def test_derivatives_by_the_profile_are_exact() -> None:
    footprint = footprint_of(stroke(bend=6), np.full(len(LEVELS), 0.2), SHAPE)
    np.testing.assert_allclose((footprint.by_level * 0.2).sum(-1), footprint.coverage, atol=1e-5)


def test_place_is_relative_to_the_direction_of_motion() -> None:
    footprint = footprint_of(stroke(), PLAIN, SHAPE)
    left, ahead = footprint.place[0, ..., 0], footprint.place[0, ..., 1]
    assert left[22, 30] == pytest.approx(0.5, abs=1e-5)  # it goes right; up, where rows are fewer, is left
    assert left[26, 30] == pytest.approx(-0.5, abs=1e-5)
    assert ahead[24, 50] == pytest.approx(0.5, abs=1e-5)
    assert ahead[24, 10] == pytest.approx(-0.5, abs=1e-5)


def test_footprint_of_one_point_and_outside_the_window() -> None:
    dot = footprint_of(stroke()[:, :1], PLAIN, SHAPE)
    assert dot.coverage.sum() == pytest.approx(0.9 * np.pi * (4**2 + 0.8**2), rel=0.01)  # of the convolved rim
    away = footprint_of(stroke(shift=500), PLAIN, SHAPE)
    assert not away.coverage.any()
    assert (away.segment == -1).all()
