"""Noise floor of pushes: repeats, single pushes, execution and scanner noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pentimento.diagnosis.pushes.floor import (
    ExecutionNoise,
    error_of_execution_noise,
    error_of_scanner_noise,
    floor_in_search,
    floor_of_test_split,
    noise_derivatives,
    noise_floor,
)
from pentimento.diagnosis.pushes.jacobian import action_losses, mean_squared_error, residual
from pentimento.diagnosis.pushes.measured import MeasuredPushes, measure
from pentimento.dynamics.pushes.analytic import AnalyticPush, first_model
from tests.dynamics.pushes.played_pushes import HALF_WIDTH_M, blank, played

SCATTER_M = np.array([3e-4, 3e-4, 2e-4])


def test_floor_is_scatter_of_repeats() -> None:
    samples = blank(12, 3)
    rng = np.random.default_rng(0)
    noisy = samples._replace(after=samples.after + 1e-4 * rng.standard_normal(samples.after.shape).astype(np.float32))
    measured = measure(noisy, 0.006)
    floor = noise_floor(first_model(measured.scene), measured, 0)
    assert floor is not None
    assert floor.mse == pytest.approx(0.01, rel=0.05)  # 0.1 mm of noise in the scan after; none in the one before


def test_floor_is_unknown_without_repeats() -> None:
    measured = measure(blank(12, 1), 0.006)
    assert noise_floor(first_model(measured.scene), measured, 0) is None
    assert floor_of_test_split(first_model(measured.scene), measured, np.arange(4), 0) is None


def test_test_split_floor_uses_own_spread_or_mean_of_repeats() -> None:
    samples = blank(12, 3)
    measured = measure(samples, 0.006)
    repeated = np.unique(measured.action)[np.unique(measured.action, return_counts=True)[1] > 1]
    rng = np.random.default_rng(0)
    loud = measured.action == repeated[0]  # one action is noisier than all others
    noise_m = np.where(loud, 4e-4, 1e-4)[:, None, None] * rng.standard_normal(measured.after.shape)
    measured = replace(measured, after=measured.after + noise_m.astype(np.float32))
    model = first_model(measured.scene)

    def floor(*actions: int) -> float:
        found = floor_of_test_split(model, measured, np.flatnonzero(np.isin(measured.action, actions)), 0)
        assert found is not None and found.interval[0] <= found.mse <= found.interval[1]
        return found.mse

    single = np.setdiff1d(measured.action, repeated)
    everywhere = noise_floor(model, measured, 0)
    assert everywhere is not None
    assert floor(repeated[0]) == pytest.approx(0.16, rel=0.1)
    assert floor(repeated[1]) == pytest.approx(0.01, rel=0.1)
    assert floor(*single) == pytest.approx(everywhere.mse, rel=0.1)
    assert floor(repeated[1], single[0]) == pytest.approx((0.01 + everywhere.mse) / 2, rel=0.1)


def test_floor_in_search_is_at_most_discovery_error() -> None:
    measured = measure(blank(12, 3), 0.006)
    repeats = [np.flatnonzero(measured.action == action) for action in np.unique(measured.action)]
    loud = np.isin(np.arange(len(measured)), np.concatenate([rows for rows in repeats if len(rows) > 1]))
    noise_m = 8e-4 * loud[:, None, None] * np.random.default_rng(0).standard_normal(measured.after.shape)
    measured = replace(measured, after=measured.after + noise_m.astype(np.float32))
    model = first_model(measured.scene)
    everywhere = noise_floor(model, measured, 0)
    assert everywhere is not None
    assert floor_in_search(model, measured, np.flatnonzero(loud), 0) == pytest.approx(everywhere.mse)
    quiet = np.flatnonzero(~loud)
    error = float(action_losses(model, measured.pick(quiet)).mean())
    assert error < everywhere.mse
    assert floor_in_search(model, measured, quiet, 0) == pytest.approx(error)


@pytest.fixture(scope="module")
def exact() -> tuple[AnalyticPush, MeasuredPushes]:
    """Pushes into new and old surfaces that a model predicts exactly."""
    measured = measure(played(actions=40, noise_m=0.0), HALF_WIDTH_M)
    model = first_model(measured.scene)
    return model, replace(measured, after=measured.scene.before + model.change(measured.scene))


def scattered(model: AnalyticPush, measured: MeasuredPushes, seed: int) -> MeasuredPushes:
    """The same pushes with execution noise."""
    beside = SCATTER_M * np.random.default_rng(seed).standard_normal((len(measured), 3))
    change = [
        model.plus(ExecutionNoise(values, {})).change(measured.scene.pick(np.array([row])))
        for row, values in enumerate(beside)
    ]
    return replace(measured, after=measured.scene.before + np.concatenate(change))


def rows_of_repeats(measured: MeasuredPushes) -> list[np.ndarray]:
    groups = [np.flatnonzero(measured.action == action) for action in np.unique(measured.action)]
    return [rows for rows in groups if len(rows) > 1]


def steepness(measured: MeasuredPushes) -> np.ndarray:
    """Mean squared slope of each push's surface, [B]."""
    slopes = np.gradient(measured.scene.before, measured.scene.pixel_m, axis=(1, 2))
    return np.square(slopes).sum(0).mean((1, 2))


def test_execution_noise_error_matches_simulation(exact: tuple[AnalyticPush, MeasuredPushes]) -> None:
    model, measured = exact
    noisy = [scattered(model, measured, seed) for seed in range(12)]
    predicted = np.mean([error_of_execution_noise(model, each, rows_of_repeats(each)) for each in noisy], axis=0)
    real = np.mean([mean_squared_error(residual(model, each), each) for each in noisy], axis=0)
    assert predicted.mean() == pytest.approx(real.mean(), rel=0.2)
    assert np.corrcoef(predicted, real)[0, 1] > 0.8  # also per push


def test_execution_noise_error_is_zero_for_exact_arm(exact: tuple[AnalyticPush, MeasuredPushes]) -> None:
    model, measured = exact
    assert error_of_execution_noise(model, measured, rows_of_repeats(measured)).max() < 1e-9


def test_scanner_noise_error_follows_slope(exact: tuple[AnalyticPush, MeasuredPushes]) -> None:
    model, measured = exact
    slopes = np.hypot(*np.gradient(measured.after, measured.scene.pixel_m, axis=(1, 2)))
    noise_m = 5e-5 * (1 + 6 * slopes) * np.random.default_rng(3).standard_normal(slopes.shape)
    noisy = replace(measured, after=measured.after + noise_m.astype(np.float32))
    predicted, real = error_of_scanner_noise(model, noisy), mean_squared_error(residual(model, noisy), noisy)
    assert predicted.mean() == pytest.approx(real.mean(), rel=0.1)
    steep = steepness(measured) > np.median(steepness(measured))
    assert predicted[steep].mean() > 1.1 * predicted[~steep].mean()
    assert predicted[steep].mean() == pytest.approx(real[steep].mean(), rel=0.15)


def test_floor_of_single_pushes_is_corrected_for_their_surface(exact: tuple[AnalyticPush, MeasuredPushes]) -> None:
    model, measured = exact
    repeated = np.concatenate(rows_of_repeats(measured))
    single = np.setdiff1d(np.arange(len(measured)), repeated)
    old = single[np.argsort(-steepness(measured)[single])[: len(single) // 2]]
    floors, real, plain = [], [], []
    for seed in range(8):
        noisy = scattered(model, measured, seed)
        floor, everywhere = floor_of_test_split(model, noisy, old, 0), noise_floor(model, noisy, 0)
        assert floor is not None and everywhere is not None
        floors.append(floor.mse)
        plain.append(everywhere.mse)
        real.append(mean_squared_error(residual(model, noisy), noisy)[old].mean())
    assert np.mean(floors) == pytest.approx(np.mean(real), rel=0.2)
    assert abs(np.mean(floors) - np.mean(real)) < abs(np.mean(plain) - np.mean(real))


def test_noise_derivatives_match_finite_differences(exact: tuple[AnalyticPush, MeasuredPushes]) -> None:
    model, measured = exact
    by = noise_derivatives(model, measured.scene)
    still = model.change(measured.scene)
    for k, step_m in enumerate(5e-5 * np.eye(3)):
        change = model.plus(ExecutionNoise(step_m, {})).change(measured.scene) - still
        assert np.abs(change / 5e-5 - by[k]).mean() < 0.05 * np.abs(by[k]).mean()


def test_scanner_noise_error_is_weighted(exact: tuple[AnalyticPush, MeasuredPushes]) -> None:
    model, measured = exact
    noise_m = 5e-5 * np.random.default_rng(3).standard_normal(measured.after.shape).astype(np.float32)
    noisy = replace(measured, after=measured.after + noise_m)
    half = replace(noisy, weight=0.5 * noisy.weight)
    np.testing.assert_allclose(error_of_scanner_noise(model, half), 0.5 * error_of_scanner_noise(model, noisy))
