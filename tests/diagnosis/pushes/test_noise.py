"""What an arm's scatter and a scanner's noise are worth is foretold for surfaces that no repeat has met."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pentimento.diagnosis.pushes.floor import floor_of_test_split, noise_floor
from pentimento.diagnosis.pushes.jacobian import mean_squared_error, residual
from pentimento.diagnosis.pushes.measured import MeasuredPushes, measure
from pentimento.diagnosis.pushes.noise import Scatter, by_scatter, error_by_scanner, error_by_scatter
from pentimento.dynamics.pushes.analytic import AnalyticPush, first_model
from tests.dynamics.pushes.played_pushes import HALF_WIDTH_M, played

SCATTER_M = np.array([3e-4, 3e-4, 2e-4])


@pytest.fixture(scope="module")
def exact() -> tuple[AnalyticPush, MeasuredPushes]:
    """Pushes into new and old surfaces, of which a model foretells everything."""
    measured = measure(played(actions=40, noise_m=0.0), HALF_WIDTH_M)
    model = first_model(measured.scene)
    return model, replace(measured, after=measured.scene.before + model.change(measured.scene))


def scattered(model: AnalyticPush, measured: MeasuredPushes, seed: int) -> MeasuredPushes:
    """The same made by an arm that comes to its place by chance."""
    beside = SCATTER_M * np.random.default_rng(seed).standard_normal((len(measured), 3))
    change = [
        model.plus(Scatter(values, {})).change(measured.scene.pick(np.array([row])))
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


def test_repeats_tell_what_scatter_does_to_each_push(exact: tuple[AnalyticPush, MeasuredPushes]) -> None:
    model, measured = exact
    made = [scattered(model, measured, seed) for seed in range(12)]
    predicted = np.mean([error_by_scatter(model, each, rows_of_repeats(each)) for each in made], axis=0)
    real = np.mean([mean_squared_error(residual(model, each), each) for each in made], axis=0)
    assert predicted.mean() == pytest.approx(real.mean(), rel=0.2)
    assert np.corrcoef(predicted, real)[0, 1] > 0.8  # which of them it harms most, too


def test_an_arm_without_scatter_has_none(exact: tuple[AnalyticPush, MeasuredPushes]) -> None:
    model, measured = exact
    assert error_by_scatter(model, measured, rows_of_repeats(measured)).max() < 1e-9


def test_untouched_slopes_tell_what_the_scanner_does_to_each_push(exact: tuple[AnalyticPush, MeasuredPushes]) -> None:
    model, measured = exact
    slopes = np.hypot(*np.gradient(measured.after, measured.scene.pixel_m, axis=(1, 2)))
    noise_m = 5e-5 * (1 + 6 * slopes) * np.random.default_rng(3).standard_normal(slopes.shape)
    noisy = replace(measured, after=measured.after + noise_m.astype(np.float32))
    predicted, real = error_by_scanner(model, noisy), mean_squared_error(residual(model, noisy), noisy)
    assert predicted.mean() == pytest.approx(real.mean(), rel=0.1)
    steep = steepness(measured) > np.median(steepness(measured))
    assert predicted[steep].mean() > 1.1 * predicted[~steep].mean()
    assert predicted[steep].mean() == pytest.approx(real[steep].mean(), rel=0.15)


def test_the_floor_of_single_pushes_into_old_surfaces_is_what_noise_makes_of_them(
    exact: tuple[AnalyticPush, MeasuredPushes],
) -> None:
    model, measured = exact
    repeated = np.concatenate(rows_of_repeats(measured))
    single = np.setdiff1d(np.arange(len(measured)), repeated)
    old = single[np.argsort(-steepness(measured)[single])[: len(single) // 2]]
    floors, real, plain = [], [], []
    for seed in range(8):
        made = scattered(model, measured, seed)
        floor, everywhere = floor_of_test_split(model, made, old, 0), noise_floor(model, made, 0)
        assert floor is not None and everywhere is not None
        floors.append(floor.mse)
        plain.append(everywhere.mse)
        real.append(mean_squared_error(residual(model, made), made)[old].mean())
    assert np.mean(floors) == pytest.approx(np.mean(real), rel=0.2)
    assert abs(np.mean(floors) - np.mean(real)) < abs(np.mean(plain) - np.mean(real))


def test_scatter_grows_as_it_is_said(exact: tuple[AnalyticPush, MeasuredPushes]) -> None:
    model, measured = exact
    by = by_scatter(model, measured.scene)
    still = model.change(measured.scene)
    for k, step_m in enumerate(5e-5 * np.eye(3)):
        change = model.plus(Scatter(step_m, {})).change(measured.scene) - still
        assert np.abs(change / 5e-5 - by[k]).mean() < 0.05 * np.abs(by[k]).mean()


def test_the_scanners_part_counts_as_much_as_its_pixels_do(exact: tuple[AnalyticPush, MeasuredPushes]) -> None:
    model, measured = exact
    noise_m = 5e-5 * np.random.default_rng(3).standard_normal(measured.after.shape).astype(np.float32)
    noisy = replace(measured, after=measured.after + noise_m)
    half = replace(noisy, weight=0.5 * noisy.weight)
    np.testing.assert_allclose(error_by_scanner(model, half), 0.5 * error_by_scanner(model, noisy))
