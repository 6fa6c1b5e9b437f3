"""Slopes at a scale: exact on planes, adjoint to their gradient, and less noisy by a known factor."""

import math

import numpy as np
import pytest

from pentimento.planning.objectives import ClayObjective, Weights, weights_for_scans
from pentimento.planning.pushes.scales import ScanObjective, resampled
from pentimento.planning.slopes import Slopes, scan_noise_m, slope_scale_m

SHAPE, PER_M = (40, 56), 500.0
WINDOW_M = (0.0, 0.0, SHAPE[1] / PER_M, SHAPE[0] / PER_M)
SCALES_M = [0.0, 0.002, 0.005, 0.03]


def rough(seed: int, shape: tuple[int, int] = SHAPE) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.04, 1e-3, shape)


@pytest.mark.parametrize("scale_m", SCALES_M)
def test_the_slope_of_a_plane_is_its_slope_up_to_the_border(scale_m: float) -> None:
    row, column = np.mgrid[: SHAPE[0], : SHAPE[1]]
    plane = 0.04 + 0.3 * column / PER_M - 0.2 * row / PER_M  # rises to the right, and up the image
    right, up = Slopes(SHAPE, PER_M, scale_m).of(plane)
    np.testing.assert_allclose(right, 0.3, atol=1e-9)
    np.testing.assert_allclose(up, 0.2, atol=1e-9)


@pytest.mark.parametrize("scale_m", SCALES_M)
def test_slopes_and_their_gradient_are_adjoint(scale_m: float) -> None:
    slopes = Slopes(SHAPE, PER_M, scale_m)
    right, up = slopes.of(rough(0))
    of_right, of_up = rough(1, right.shape), rough(2, up.shape)
    forward = (right * of_right).sum() + (up * of_up).sum()
    assert forward == pytest.approx(float((slopes.back(of_right, of_up) * rough(0)).sum()), rel=1e-9)


@pytest.mark.parametrize("scale_px", [1.5, 3.0])
def test_white_noise_has_the_variance_that_the_scale_was_chosen_by(scale_px: float) -> None:
    noise = np.random.default_rng(3).normal(0, 1e-4, (200, 200))
    inside = (slice(20, -20), slice(20, -20))
    for slope in Slopes((200, 200), PER_M, scale_px / PER_M).of(noise):
        expected = (1e-4 * PER_M) ** 2 / (8 * math.pi * scale_px**4)
        assert slope[inside].var() == pytest.approx(expected, rel=0.15)


def test_the_scale_keeps_the_noise_below_what_is_tolerated() -> None:
    noise_m, tolerated = 2e-4, 5e-4
    scale_m = slope_scale_m(noise_m, PER_M, tolerated)
    noise = np.random.default_rng(4).normal(0, noise_m, (200, 200))
    squared = sum(float(np.square(slope).mean()) for slope in Slopes((200, 200), PER_M, scale_m).of(noise))
    assert squared == pytest.approx(tolerated, rel=0.25)
    plain = sum(float(np.square(slope).mean()) for slope in Slopes((200, 200), PER_M).of(noise))
    assert plain == pytest.approx((noise_m * PER_M) ** 2, rel=0.05) and plain > 15 * tolerated
    assert slope_scale_m(1e-6, PER_M, tolerated) == 0.0


def test_noise_is_estimated_from_two_scans_whatever_their_level_and_their_bad_pixels() -> None:
    rng = np.random.default_rng(5)
    one, other = (rough(0) + rng.normal(0, 6e-5, SHAPE) for _ in range(2))
    other += 1e-3
    other[:3] += 0.01
    assert scan_noise_m(one, other) == pytest.approx(6e-5, rel=0.1)


@pytest.mark.parametrize("scale_m", SCALES_M[1:])
def test_objective_at_a_scale_has_its_gradient_and_its_values(scale_m: float) -> None:
    objective = ClayObjective(rough(0), WINDOW_M, Weights(1.0, 3.0, scale_m))  # type: ignore[arg-type]
    before, way = rough(1), np.random.default_rng(6).normal(size=SHAPE)
    ends = [float(objective.values(before + step * way)) for step in (-1e-5, 1e-5)]
    value, gradient = objective(before)  # type: ignore[arg-type]
    assert value == pytest.approx(float(objective.values(before)))
    assert (ends[1] - ends[0]) / 2e-5 == pytest.approx(float((gradient * way).sum()), rel=1e-6)
    after = np.stack([before, before, before])
    after[0, :6, 50:] -= 1e-3  # at the corner
    after[1, 20:30, 10:25] += 1e-3
    np.testing.assert_allclose(objective.values_from(before, after), objective.values(after), rtol=1e-9)


def test_scan_objective_takes_slopes_at_the_scale_of_the_scan() -> None:
    scan, goal = rough(2).astype(np.float32), rough(3).astype(np.float32)
    of_scan = ClayObjective(goal, WINDOW_M, Weights(1.0, 3.0, 0.005))
    start = resampled(scan, (20, 28))
    coarse = ScanObjective(of_scan, scan, start)
    assert float(coarse.visual_error(start)) == pytest.approx(float(of_scan.visual_error(scan)), rel=1e-6)
    lower = start.copy()
    lower[5:12, 8:20] -= 1e-3
    way = (lower - start).astype(np.float64)
    ends = [float(coarse.values((start + step * way).astype(np.float64))) for step in (-1e-3, 1e-3)]
    assert (ends[1] - ends[0]) / 2e-3 == pytest.approx(float((coarse(start)[1] * way).sum()), rel=1e-3)


def test_two_scans_choose_the_scale_at_which_their_noise_hardly_counts() -> None:
    clay = np.full((64, 64), 0.04, np.float32)
    goal = clay.copy()
    goal[20:44, 20:44] -= 0.003
    window_m, rng = (0.0, 0.0, 0.1, 0.1), np.random.default_rng(7)
    quiet, loud = (
        weights_for_scans(
            Weights(1.0, 4.0), goal, window_m,
            tuple((clay + noise_m * rng.normal(size=clay.shape)).astype(np.float32) for _ in range(2)),  # type: ignore
        )
        for noise_m in (1e-5, 4e-4)
    )  # fmt: skip
    assert quiet == Weights(1.0, 4.0)
    assert (loud.error_3d, loud.visual) == (1.0, 4.0) and loud.slope_scale_m > 1 / 640
    plain, at_scale = (ClayObjective(clay, window_m, weights) for weights in (quiet, loud))
    noisy = (clay + 4e-4 * rng.normal(size=clay.shape)).astype(np.float32)
    error = float(plain.visual_error(goal))
    assert float(plain.visual_error(noisy)) > 0.5 * error
    assert float(at_scale.visual_error(noisy)) < 0.08 * error


def test_a_scale_rejects_negative_numbers() -> None:
    with pytest.raises(ValueError, match="slope_scale_m"):
        Weights(1.0, 1.0, -0.001)
