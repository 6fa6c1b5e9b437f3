"""Least squares on pushes: convergence, bounds, Jacobian statistics, weights and modes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pentimento.diagnosis.gauss_newton import Statistics
from pentimento.diagnosis.pushes import fit as fitting
from pentimento.diagnosis.pushes import jacobian
from pentimento.diagnosis.pushes.fit import equalised, fit
from pentimento.diagnosis.pushes.jacobian import (
    KeptColumns,
    Slopes,
    action_losses,
    derivatives,
    linearise,
    linearise_rows,
    residual,
    slopes_of,
)
from pentimento.diagnosis.pushes.measured import MeasuredPushes, measure
from pentimento.diagnosis.pushes.modes import MODES, AllModes, mode_scores
from pentimento.planning.pushes.analytic.mechanisms.adhesion_lift import AdhesionLift
from pentimento.planning.pushes.analytic.mechanisms.height_offset import HeightOffset
from pentimento.planning.pushes.analytic.model import BASE, KNOTS, PROFILE, AnalyticPush, first_model, identity
from pentimento.planning.pushes.analytic.scene import PushScene, distance_from_path
from tests.diagnosis.pushes.conftest import Played
from tests.dynamics.pushes.played_pushes import DEEP_M, HALF_WIDTH_M, blank, first_model_of, mechanism, played


def test_fit_is_converged(lossy: Played) -> None:
    first = fit(first_model(lossy.measured.scene), lossy.measured)
    fitted = fit(first, lossy.measured)  # the prior's weight follows the error at the start
    again = fit(fitted, lossy.measured)
    left, minimum = (action_losses(model, lossy.measured).mean() for model in (fitted, again))
    assert left - minimum < 2e-3 * left


def test_flat_tip_is_not_attributed_to_height_offset() -> None:
    ball = first_model_of(DEEP_M)
    radius_mm, half_mm = 1e3 * ball.ball_radius_m, 1e3 * HALF_WIDTH_M
    flattened = dict(zip(BASE, ball.base, strict=True))
    for name, knot in zip(PROFILE, KNOTS, strict=True):
        distance_mm, flat_mm = knot * half_mm, 0.3 * half_mm
        flattened[name] = (max(distance_mm - flat_mm, 0.0) ** 2 - distance_mm**2) / (2 * radius_mm)
    tool = ball.at(np.array(list(flattened.values())))
    measured = measure(played(model=tool))
    fitted = fit(first_model(measured.scene).plus(identity(HeightOffset, measured.scene)), measured)
    assert np.abs(fitted.mechanisms[-1].values).max() < 2e-4


def test_reused_jacobian_converges_as_low_as_fresh_one(lossy: Played, monkeypatch: pytest.MonkeyPatch) -> None:
    measured = lossy.measured
    start = first_model(measured.scene)
    taken = []

    def counted(model: AnalyticPush, measured: MeasuredPushes) -> Slopes:
        taken.append(model)
        return slopes_of(model, measured)

    monkeypatch.setattr(fitting, "slopes_of", counted)
    kept = fit(start, measured)
    fewer = len(taken)
    monkeypatch.setattr(fitting, "_NEARLY_LINEAR", math.inf)
    fresh = fit(start, measured)
    assert fewer < len(taken) - fewer
    assert action_losses(kept, measured).mean() <= 1.005 * action_losses(fresh, measured).mean()


@pytest.mark.parametrize("seed", range(4))
def test_unsigned_quantities_stay_non_negative(seed: int) -> None:
    """Without a dwell effect, an unbounded fit would be negative in every second table."""
    hidden = mechanism(AdhesionLift, blank(), lift_by_log_speed_m=0.001)
    measured = measure(played([hidden], seed=seed), HALF_WIDTH_M)
    start = first_model(measured.scene).plus(identity(AdhesionLift, measured.scene))
    by_speed_m, by_dwell_m = fit(start, measured).mechanisms[-1].values
    assert by_speed_m == pytest.approx(0.001, abs=2e-4)
    assert 0 <= by_dwell_m < 1e-4


@pytest.fixture(scope="module")
def measured() -> MeasuredPushes:
    return measure(played(actions=14, repeats=2), 0.006)


def test_statistics_predict_error_of_small_step(measured: MeasuredPushes) -> None:
    model = first_model(measured.scene)
    statistics = linearise(model, measured)
    rng = np.random.default_rng(1)
    step = 0.01 * rng.standard_normal(len(model.vector))
    predicted = (
        statistics.energy - 2 * statistics.slope @ step + np.einsum("p,npq,q->n", step, statistics.curvature, step)
    )
    found = action_losses(model.at(model.vector + step), measured)
    assert np.allclose(predicted, found, rtol=0.02)
    assert np.allclose(statistics.energy, action_losses(model, measured), rtol=1e-4)


def test_reused_jacobian_gives_statistics_of_nearby_model(measured: MeasuredPushes) -> None:
    model = first_model(measured.scene)
    slopes = slopes_of(model, measured)
    near = model.at(model.vector + 0.01)
    here, there, own = linearise(model, measured), slopes.statistics(near), linearise(near, measured)
    assert _are_close(slopes.statistics(model), here)
    assert np.array_equal(there.curvature, here.curvature)
    assert np.allclose(there.energy, own.energy, rtol=1e-5)
    assert np.abs(there.slope - own.slope).max() < 0.3 * np.abs(here.slope - own.slope).max()
    some = np.array([4, 0, 7])
    assert _are_close(slopes.of(some).statistics(near), there.of(some))


def test_kept_columns_serve_models_that_differ_in_mechanisms_at_zero(
    measured: MeasuredPushes, monkeypatch: pytest.MonkeyPatch
) -> None:
    offset, lift = (identity(kind, measured.scene) for kind in (HeightOffset, AdhesionLift))
    acting = type(offset)(np.array([2e-4, 0.0, 1e-4]), offset.reference)
    start = first_model(measured.scene)
    near = start.at(start.vector + 0.01)
    kept, computed = KeptColumns(measured), []

    def counted(model: AnalyticPush, scene: PushScene, columns: Sequence[int] | None = None) -> NDArray[Any]:
        computed.append(len(model.vector) if columns is None else len(columns))
        return derivatives(model, scene, columns)

    for model, fresh in (
        (start.plus(offset, lift), True),
        (start.plus(lift), False),  # a subset in another order
        (start.plus(lift, offset), False),
        (near, True),
        (start.plus(acting), True),
        (start.plus(acting, lift), True),  # the lift beside an acting offset
        (start, False),
    ):
        expected = linearise(model, measured)
        with monkeypatch.context() as patch:
            patch.setattr(jacobian, "derivatives", counted)
            computed.clear()
            assert _are_close(linearise(model, measured, kept), expected)
            assert bool(computed) == fresh


def test_kept_columns_are_bounded_by_memory(measured: MeasuredPushes, monkeypatch: pytest.MonkeyPatch) -> None:
    model = first_model(measured.scene)
    monkeypatch.setattr(jacobian, "_MOST_KEPT_BYTES", 1.5 * len(model.vector) * measured.after.nbytes)
    kept = KeptColumns(measured)
    for step in (0.0, 0.01, 0.02):
        there = model.at(model.vector + step)
        assert _are_close(linearise(there, measured, kept), linearise(there, measured))
        assert len(kept) == 1


def test_statistics_are_independent_of_thread_count(measured: MeasuredPushes, monkeypatch: pytest.MonkeyPatch) -> None:
    model, found = first_model(measured.scene), []
    for threads in (1, 2):
        monkeypatch.setattr(jacobian, "get_num_threads", lambda threads=threads: threads)
        found.append((*linearise_rows(model, measured), residual(model, measured)))
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)


def test_statistics_ignore_holes(measured: MeasuredPushes) -> None:
    model = first_model(measured.scene)
    known = measured.samples.known.copy()
    known[:, :, 40:] = False
    part = replace(measured, samples=measured.samples._replace(known=known))
    spoilt = replace(part, after=np.where(known, part.after, 1.0).astype(np.float32))
    for one, other in zip(linearise_rows(model, part), linearise_rows(model, spoilt), strict=True):
        assert np.allclose(one, other, rtol=1e-5)


def test_weights_equalise_pushes_and_distances(measured: MeasuredPushes) -> None:
    model = first_model(measured.scene)
    even = equalised(measured, model)
    spread = [action_losses(model, pushes) for pushes in (measured, even)]
    assert spread[1].std() / spread[1].mean() < 0.7 * spread[0].std() / spread[0].mean()
    near, squared = distance_from_path(measured.scene) < 1, np.square(residual(model, measured))
    contrast = [(w * squared)[near].mean() / (w * squared)[~near].mean() for w in (measured.weight, even.weight)]
    assert contrast[1] < 0.2 * contrast[0]
    assert even.weight[measured.valid].mean() == pytest.approx(1.0, rel=1e-4)
    assert np.allclose(linearise(model, even).energy, spread[1], rtol=1e-4)


@pytest.mark.parametrize(("mode", "amount"), [("depth", 0.2), ("width", -0.1), ("along", 0.001), ("volume", 0.2)])
def test_mode_scores_recover_mode_amount(mode: str, amount: float, measured: MeasuredPushes) -> None:
    model = first_model(measured.scene)
    values = amount * (np.arange(len(MODES)) == MODES.index(mode))
    changed = model.plus(AllModes(values, {})).change(measured.scene)
    played_out = replace(measured, after=measured.scene.before + changed)
    scores = (
        mode_scores(model, played_out).amounts[:, MODES.index(mode)] * AllModes.quantities[MODES.index(mode)].typical
    )
    assert np.median(scores) == pytest.approx(amount, rel=0.25)


def _are_close(one: Statistics, other: Statistics) -> bool:
    return all(np.allclose(a, b, rtol=1e-5, atol=1e-9) for a, b in zip(one, other, strict=True))
