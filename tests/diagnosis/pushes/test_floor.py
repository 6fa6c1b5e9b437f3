"""Noise floor of pushes, and the effect of execution noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pentimento.diagnosis.pushes.floor import ExecutionNoise, noise_derivatives, noise_floor
from pentimento.diagnosis.pushes.measured import MeasuredPushes, measure
from pentimento.planning.pushes.analytic.model import AnalyticPush, first_model
from tests.dynamics.pushes.played_pushes import HALF_WIDTH_M, blank, played


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


@pytest.fixture(scope="module")
def exact() -> tuple[AnalyticPush, MeasuredPushes]:
    """Pushes into new and old surfaces that a model predicts exactly."""
    measured = measure(played(actions=40, noise_m=0.0), HALF_WIDTH_M)
    model = first_model(measured.scene)
    return model, replace(measured, after=measured.scene.before + model.change(measured.scene))


def test_floor_does_not_contain_what_the_model_predicts_of_repeats(exact: tuple[AnalyticPush, MeasuredPushes]) -> None:
    """Repeats meet different surfaces, so their changes differ; a model that knows why leaves no noise."""
    model, measured = exact
    floor = noise_floor(model, measured, 0)
    assert floor is not None
    assert floor.mse < 1e-9
    flat = replace(measured, after=measured.after - model.change(measured.scene))
    raw = noise_floor(model, flat, 0)
    assert raw is not None
    assert raw.mse > 1e-4


def test_noise_derivatives_match_finite_differences(exact: tuple[AnalyticPush, MeasuredPushes]) -> None:
    model, measured = exact
    by = noise_derivatives(model, measured.scene)
    still = model.change(measured.scene)
    for k, step_m in enumerate(5e-5 * np.eye(3)):
        change = model.plus(ExecutionNoise(step_m, {})).change(measured.scene) - still
        assert np.abs(change / 5e-5 - by[k]).mean() < 0.05 * np.abs(by[k]).mean()
