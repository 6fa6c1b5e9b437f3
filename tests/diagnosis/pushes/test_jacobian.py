"""Statistics of pushes: second-order truth of the error, weights, and modes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pentimento.diagnosis.gauss_newton import Statistics
from pentimento.diagnosis.pushes import jacobian
from pentimento.diagnosis.pushes.fit import equalised
from pentimento.diagnosis.pushes.jacobian import action_losses, linearise, linearise_rows, residual, slopes_of
from pentimento.diagnosis.pushes.measured import MeasuredPushes, measure
from pentimento.diagnosis.pushes.modes import MODES, AllModes, mode_scores
from pentimento.dynamics.pushes.analytic import first_model
from pentimento.dynamics.pushes.analytic_scene import from_way
from tests.dynamics.pushes.played_pushes import played


@pytest.fixture(scope="module")
def measured() -> MeasuredPushes:
    return measure(played(actions=14, repeats=2), 0.006)


def test_the_statistics_foretell_the_error_of_a_small_step(measured: MeasuredPushes) -> None:
    model = first_model(measured.scene)
    statistics = linearise(model, measured)
    rng = np.random.default_rng(1)
    step = 0.01 * rng.standard_normal(len(model.vector))
    said = statistics.energy - 2 * statistics.slope @ step + np.einsum("p,npq,q->n", step, statistics.curvature, step)
    found = action_losses(model.at(model.vector + step), measured)
    assert np.allclose(said, found, rtol=0.02)
    assert np.allclose(statistics.energy, action_losses(model, measured), rtol=1e-4)


def test_kept_slopes_tell_the_statistics_of_their_model_and_of_one_nearby(measured: MeasuredPushes) -> None:
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


def test_any_number_of_threads_gives_the_same_bits(measured: MeasuredPushes, monkeypatch: pytest.MonkeyPatch) -> None:
    model, found = first_model(measured.scene), []
    for threads in (1, 2):
        monkeypatch.setattr(jacobian, "get_num_threads", lambda threads=threads: threads)
        found.append((*linearise_rows(model, measured), residual(model, measured)))
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)


def test_holes_do_not_count(measured: MeasuredPushes) -> None:
    model = first_model(measured.scene)
    known = measured.samples.known.copy()
    known[:, :, 40:] = False
    part = replace(measured, samples=measured.samples._replace(known=known))
    spoilt = replace(part, after=np.where(known, part.after, 1.0).astype(np.float32))
    for one, other in zip(linearise_rows(model, part), linearise_rows(model, spoilt), strict=True):
        assert np.allclose(one, other, rtol=1e-5)


def test_weights_make_pushes_and_places_equal_and_count_in_the_statistics(measured: MeasuredPushes) -> None:
    model = first_model(measured.scene)
    even = equalised(measured, model)
    spread = [action_losses(model, pushes) for pushes in (measured, even)]
    assert spread[1].std() / spread[1].mean() < 0.7 * spread[0].std() / spread[0].mean()
    near, squared = from_way(measured.scene) < 1, np.square(residual(model, measured))
    contrast = [(w * squared)[near].mean() / (w * squared)[~near].mean() for w in (measured.weight, even.weight)]
    assert contrast[1] < 0.2 * contrast[0]
    assert even.weight[measured.valid].mean() == pytest.approx(1.0, rel=1e-4)
    assert np.allclose(linearise(model, even).energy, spread[1], rtol=1e-4)


@pytest.mark.parametrize(("mode", "amount"), [("depth", 0.2), ("width", -0.1), ("along", 0.001), ("volume", 0.2)])
def test_a_push_that_differs_in_a_mode_scores_in_it(mode: str, amount: float, measured: MeasuredPushes) -> None:
    model = first_model(measured.scene)
    values = amount * (np.arange(len(MODES)) == MODES.index(mode))
    changed = model.plus(AllModes(values, {})).change(measured.scene)
    played_out = replace(measured, after=measured.scene.before + changed)
    scores = mode_scores(model, played_out)[0][:, MODES.index(mode)] * AllModes.quantities[MODES.index(mode)].typical
    assert np.median(scores) == pytest.approx(amount, rel=0.25)


def _are_close(one: Statistics, other: Statistics) -> bool:
    return all(np.allclose(a, b, rtol=1e-5, atol=1e-9) for a, b in zip(one, other, strict=True))
