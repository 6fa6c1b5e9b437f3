"""The standard frame: invariants of the transform, and the way back."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pentimento.contracts.errors import ContractError
from pentimento.handwriting.recording import (
    resample,
    standardise,
    to_source,
    turned,
)


def curve(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    xy = np.cumsum(rng.normal(1e-3, 1e-3, (50, 2)), axis=0)
    return np.column_stack([np.arange(50) / 100, xy, np.full(50, np.nan), rng.uniform(0, 1, 50)])


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
def test_standard_frame_round_trip(seed: int) -> None:
    points = curve(seed)
    standard, transform = standardise(points, 32)
    assert standard.shape == (32, 5)
    np.testing.assert_allclose(standard[0, 1:3], 0, atol=1e-12)
    assert standard[-1, 2] == pytest.approx(0, abs=1e-12)
    assert standard[-1, 1] > 0
    np.testing.assert_allclose(to_source(standard, transform)[:, 1:3], resample(points, 32)[:, 1:3], atol=1e-12)


def test_pose_changes_the_transform_only() -> None:
    points = curve(3)
    moved = points.copy()
    moved[:, 1:3] = turned(points[:, 1:3], 0.7) + np.array([0.1, -0.05])
    (one, before), (other, after) = standardise(points, 32), standardise(moved, 32)
    np.testing.assert_allclose(one, other, atol=1e-12)
    assert after[2] - before[2] == pytest.approx(0.7)


def test_standardise_gives_even_steps_and_keeps_closed_heading() -> None:
    angle = np.linspace(0, 2 * np.pi, 200)
    circle = np.column_stack([angle, np.cos(angle), np.sin(angle), angle * np.nan, angle * np.nan])
    circle[-1, 1:3] = circle[0, 1:3]
    standard, transform = standardise(circle, 32)
    step = np.linalg.norm(np.diff(standard[:, 1:3], axis=0), axis=1)
    assert np.ptp(step) < 1e-3 * step.mean()
    np.testing.assert_allclose(transform, [1, 0, 0], atol=1e-12)


@pytest.mark.parametrize(("count", "points"), [(1, 50), (32, 1)])
def test_standardise_rejects_points_and_empty_strokes(count: int, points: int) -> None:
    with pytest.raises(ContractError, match="stroke"):
        standardise(curve(1)[:points], count)
