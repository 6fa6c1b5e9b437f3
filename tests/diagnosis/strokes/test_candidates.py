"""Evidence for candidates, and constraints on their refits."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.gauss_newton import Statistics
from pentimento.diagnosis.score import Evidence
from pentimento.diagnosis.strokes import candidates
from pentimento.diagnosis.strokes.candidates import (
    backward_elimination,
    can_mimic,
    evaluate_candidates,
    form_error_share,
    is_far,
    is_physical,
    shortlist,
    with_refit_evidence,
)
from pentimento.diagnosis.strokes.fit import first_model, fit
from pentimento.diagnosis.strokes.measured import load_measured
from pentimento.diagnosis.strokes.model import WIDTHS, Model, UnevenEnds, identity
from pentimento.diagnosis.strokes.predict import predicted
from pentimento.dynamics.strokes.mechanisms.bristle_lag import BristleLag
from pentimento.dynamics.strokes.mechanisms.ink_depletion import InkDepletion
from pentimento.dynamics.strokes.mechanisms.latency import Latency
from pentimento.dynamics.strokes.mechanisms.lens_distortion import LensDistortion
from pentimento.dynamics.strokes.mechanisms.path_offset import PathOffset
from pentimento.dynamics.strokes.mechanisms.path_scale import PathScale
from pentimento.dynamics.strokes.mechanisms.speed_width import SpeedWidth
from pentimento.dynamics.strokes.mechanisms.vignetting import Vignetting
from tests.diagnosis.strokes.test_large_effects import strokes_of
from tests.diagnosis.strokes.test_learned_residual import photographed


def test_displacement_is_far_beyond_the_marks_half_width() -> None:
    measured = load_measured(example_table(12))
    base = fit(first_model(measured), measured)
    half_m = 1e-3 * float(base.base[: len(WIDTHS)].mean())

    def shifted(by_m: float) -> Model:
        return base.plus(PathOffset(torch.tensor([by_m, 0.0], dtype=torch.float64), {}))

    assert is_far(shifted(2 * half_m), measured) and not is_far(shifted(0.5 * half_m), measured)


def test_shortlists_significant_cause_with_small_second_order_gain() -> None:
    """A lag of millimetres is far from linear: its test is sure, what it would gain to second order is not."""
    lag = Evidence(0.001, 0.003, 0.02, (-0.001, 0.04), -0.0001)
    assert worth_a_refit({"bristle_lag": lag, "path_scale": lag._replace(p_adjusted=0.5)}, 0.01) == ["bristle_lag"]
    assert worth_a_refit({"bristle_lag": lag._replace(gain=-0.001)}, 0.01) == []


def worth_a_refit(evidence: dict[str, Evidence], limit: float) -> list[str]:
    observable = {kind.cause: kind(torch.zeros(len(kind.quantities)), {}) for kind in (BristleLag, PathScale)}
    return shortlist(evidence, limit, 0.05, observable=observable)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("picked_up", "lens"), [(0.0, True), (1.7, True), (4.0, False), (-1.0, False)])
def test_pure_scale_is_not_physical_as_lens(picked_up: float, lens: bool, sign: float) -> None:
    values = sign * torch.tensor([1.0, picked_up], dtype=torch.float64)
    assert is_physical(LensDistortion(values, {"x_m": 0.0, "y_m": 0.0, "half_m": 0.1})) == lens


def test_gradient_of_the_prior_is_charged_to_no_cause() -> None:
    """Paint has another colour than recorded, beyond the prior's scale, in every stroke."""
    measured = load_measured(example_table(40))
    recorded = fit(first_model(measured), measured)
    after = predicted(replace(recorded, color_offset=recorded.color_offset + 0.1), measured)
    noisy = after + 0.02 * np.random.default_rng(0).standard_normal(after.shape)
    strokes = photographed(measured, noisy)
    model = fit(first_model(strokes), strokes)
    lag = identity(BristleLag, strokes.context)
    assert evaluate_candidates(model, [lag], strokes, seed=0)[0][BristleLag.cause].p > 0.05


def test_implausible_nuisance_steps_hide_no_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    """Paint ten prior scales from its recorded colour would explain nearly as much as a lens."""
    measured = load_measured(example_table(60))
    measured = replace(measured, samples=measured.samples._replace(action=torch.arange(60)), block=np.arange(60))
    model, darker = first_model(measured), identity(Vignetting, measured.context)
    columns = len(model.vector) + len(darker.quantities)
    rng = np.random.default_rng(0)
    by_number = np.zeros((60, 40, columns))
    by_number[..., len(model.base)] = 1.0  # red
    by_number[..., len(model.vector)] = 1.0 + 0.1 * rng.standard_normal((60, 1))
    missing = 0.3 * by_number[..., len(model.vector)] + rng.standard_normal((60, 40))
    statistics = Statistics(
        np.einsum("anp,anq->apq", by_number, by_number) / 40,
        np.einsum("anp,an->ap", by_number, missing) / 40,
        np.square(missing).mean(1),
    )
    monkeypatch.setattr(candidates, "linearise", lambda model, measured: statistics)
    stiff = evaluate_candidates(model, [darker], measured, seed=0)[0][Vignetting.cause]
    monkeypatch.setattr(candidates, "stiffened", lambda statistics, model, share: statistics)
    free = evaluate_candidates(model, [darker], measured, seed=0)[0][Vignetting.cause]
    assert stiff.p < 0.001 and stiff.gain > 0 and free.p > 0.05


def test_refit_from_known_statistics_is_the_same() -> None:
    strokes = load_measured(example_table(40))
    model = fit(first_model(strokes), strokes)
    observable = {kind.cause: identity(kind, strokes.context) for kind in (BristleLag, PathScale)}
    _, at_start = evaluate_candidates(model, list(observable.values()), strokes, seed=0)
    from_tests = {cause: fit(model.plus(kind), strokes, at_start[cause]) for cause, kind in observable.items()}
    for cause, kind in observable.items():
        np.testing.assert_allclose(from_tests[cause].vector, fit(model.plus(kind), strokes).vector, atol=1e-5)


@pytest.mark.parametrize(("p", "stay"), [(0.001, {"uneven_ends", "path_scale"}), (0.03, {"path_scale"}), (0.2, set())])
def test_backward_elimination_is_stricter_for_uneven_ends(
    p: float, stay: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    measured = load_measured(example_table(12))
    model = first_model(measured).plus(*(identity(k, measured.context) for k in (UnevenEnds, PathScale, BristleLag)))
    monkeypatch.setattr(candidates, "paired_p", lambda differences, seed: p)
    left = backward_elimination(model, frozenset(), measured, seed=0, log=lambda line: None)
    assert {m.cause for m in left.mechanisms} == stay | {"bristle_lag"}


@pytest.mark.parametrize("offset_m", [0.001, 0.0])
def test_refit_evidence_replaces_insignificant_score_test(offset_m: float) -> None:
    strokes, plain = strokes_of(PathOffset, offset_m, 0.0)
    silent = {PathOffset.cause: Evidence(0.5, 0.9, 0.01, (-0.01, 0.02), -0.01)}
    refit = fit(plain.plus(identity(PathOffset, strokes.context)), strokes)
    evidence = with_refit_evidence(silent, {PathOffset.cause: refit}, 0.01, model=plain, measured=strokes, seed=0)
    assert (evidence[PathOffset.cause].p_adjusted < 0.01) == (offset_m > 0)
    evidence = {PathOffset.cause: Evidence(0.001, 0.002, 0.01, (0.005, 0.02), 0.006)}
    assert (
        with_refit_evidence(evidence, {PathOffset.cause: refit}, 0.01, model=plain, measured=strokes, seed=0)
        == evidence
    )


def test_backward_elimination_drops_causes_with_impossible_sign() -> None:
    strokes, plain = strokes_of(BristleLag, -0.002)
    model = fit(plain.plus(*(identity(kind, strokes.context) for kind in (BristleLag, PathOffset))), strokes)
    assert float(model.mechanisms[0].values) < 0
    kept = frozenset({BristleLag.cause})
    assert [m.cause for m in backward_elimination(model, kept, strokes, seed=0, log=lambda _: None).mechanisms] == [
        PathOffset.cause
    ]


def test_only_causes_of_one_kind_can_mimic_each_other() -> None:
    kinds = (BristleLag, PathScale, LensDistortion, PathOffset, SpeedWidth)
    lag, scale, lens, offset, width = (kind(torch.zeros(len(kind.quantities)), {}) for kind in kinds)
    assert can_mimic(lag, scale) and can_mimic(lens, offset)
    assert not can_mimic(offset, lag)
    assert not can_mimic(lag, width) and not can_mimic(width, lag)


def test_form_error_is_largest_within_a_family() -> None:
    kinds = (Latency, BristleLag, LensDistortion, PathOffset, SpeedWidth, InkDepletion)
    late, lag, lens, offset, width, ink = (kind(torch.zeros(len(kind.quantities)), {}) for kind in kinds)
    assert set(late.informative_covariates) & set(lens.informative_covariates) and not set(
        ink.informative_covariates
    ) & set(width.informative_covariates)
    assert form_error_share(late, lag) > form_error_share(late, lens) > form_error_share(width, ink) > 0
    assert form_error_share(late, offset) == form_error_share(
        late, lens
    )  # on average, a form may leave the same for all
    assert form_error_share(late, width) == 0  # one displaces the mark, the other does not
