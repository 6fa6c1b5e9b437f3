"""The generic modulator on strokes whose modes follow a covariate by a known law."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pentimento.contracts.colour import linear_to_srgb
from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.residual_structure import Unexplained
from pentimento.diagnosis.strokes.fit import first_model, fit
from pentimento.diagnosis.strokes.measured import Measured, load_measured
from pentimento.diagnosis.strokes.model import BASE, Model
from pentimento.diagnosis.strokes.modes import (
    MODES,
    AllModes,
    Curve,
    Generic,
    Modulation,
    Modulator,
    evaluate_modulator,
    fit_modulator,
    modulated,
)
from pentimento.diagnosis.strokes.predict import ink, mark_px, predicted_linear, residual

NOISE = 0.02
KNOWN, TEST_SPLIT = np.arange(54), np.arange(54, 72)


def left(mode: str, covariate: str) -> list[Unexplained]:
    return [Unexplained(mode, covariate, 0.001, 0.0)]


def measured_with(mode: str, amounts: np.ndarray, columns: dict[str, np.ndarray]) -> tuple[Model, Measured]:
    """Strokes as a fitted model would leave them if ``mode`` (typical sizes) had these amounts, with noise."""
    plain = load_measured(example_table(72, seed=4))
    model = fit(first_model(plain), plain, iterations=4)
    table = {f"modulation_{mode}": amounts * Modulation.quantities[MODES.index(mode)].typical}
    moved = replace(plain, covariates=table)
    laid = ink(model.plus(Modulation(torch.zeros(len(MODES)), {})), moved)
    noise = NOISE * np.random.default_rng(1).standard_normal(plain.samples.after.shape)
    after = np.where(
        plain.samples.valid.numpy()[..., None] > 0, linear_to_srgb(predicted_linear(laid, moved)) + noise, 0.0
    )
    samples = plain.samples._replace(after=torch.tensor(after, dtype=torch.float32), action=torch.arange(len(plain)))
    return model, replace(plain, samples=samples, covariates=columns, block=np.arange(len(plain)) // 3)


HUMIDITY = np.random.default_rng(2).uniform(0.3, 0.6, 72)
LAW = 1.5 * np.sin(2 * np.pi * (HUMIDITY - 0.3) / 0.4)


@pytest.fixture(scope="module")
def humid() -> tuple[Model, Measured]:
    decoy = np.random.default_rng(3).normal(size=72)
    return measured_with("width", LAW, {"humidity": HUMIDITY, "decoy": decoy})


@pytest.fixture(scope="module")
def generic_result(humid: tuple[Model, Measured]) -> Generic:
    model, strokes = humid
    both = left("width", "humidity") + left("normal", "decoy")
    return evaluate_modulator(model, strokes.pick(KNOWN), strokes.pick(TEST_SPLIT), left=both, seed=0)


def test_modulator_closes_most_of_a_covariates_gap(humid: tuple[Model, Measured], generic_result: Generic) -> None:
    model, strokes = humid
    test_split = strokes.pick(TEST_SPLIT)
    valid = test_split.samples.valid.numpy()
    base = np.square(residual(model, test_split)).sum((1, 2, 3)) / valid.sum((1, 2)) / 3
    closed = generic_result.gain / (1 - NOISE**2 / base.mean())
    assert closed > 0.8
    assert 0 < generic_result.gain_interval[0] < generic_result.gain < generic_result.gain_interval[1] < 1
    assert generic_result.gain_of["width", "humidity"] == pytest.approx(generic_result.gain, abs=0.05)
    assert abs(generic_result.gain_of["normal", "decoy"]) < 0.03
    np.testing.assert_allclose(generic_result.losses.mean(), (1 - generic_result.gain) * base.mean(), rtol=1e-5)


def test_modulator_recovers_the_law(generic_result: Generic) -> None:
    (curve,) = [curve for curve in generic_result.modulator.curves if curve.mode == "width"]
    law = np.interp(curve.knots, np.sort(HUMIDITY), LAW[np.argsort(HUMIDITY)])
    assert np.corrcoef(curve.amounts, law)[0, 1] > 0.95
    amounts = np.interp(HUMIDITY[KNOWN], curve.knots, curve.amounts)
    assert amounts.mean() == pytest.approx(0.0, abs=1e-9)  # what all strokes have in common is the base's
    assert np.ptp(curve.amounts) == pytest.approx(np.ptp(law), rel=0.35)


def test_shuffled_covariate_closes_nothing(humid: tuple[Model, Measured]) -> None:
    model, strokes = humid
    shuffled = replace(strokes, covariates={"humidity": np.random.default_rng(7).permutation(HUMIDITY)})
    found = evaluate_modulator(
        model, shuffled.pick(KNOWN), shuffled.pick(TEST_SPLIT), left=left("width", "humidity"), seed=0
    )
    assert found.gain < 0.1


def test_modulator_finds_shifts(humid: tuple[Model, Measured]) -> None:
    model, strokes = measured_with("normal", 2 * np.sign(HUMIDITY - 0.45), {"humidity": HUMIDITY})
    found = evaluate_modulator(
        model, strokes.pick(KNOWN), strokes.pick(TEST_SPLIT), left=left("normal", "humidity"), seed=0
    )
    assert found.gain_interval[0] > 0.2
    (curve,) = found.modulator.curves
    assert curve.amounts[0] < -1 and curve.amounts[-1] > 1


def test_modulator_is_empty_without_structure(humid: tuple[Model, Measured]) -> None:
    """Cross-validation over blocks rejects curves on noise."""
    model, strokes = measured_with("width", np.zeros(72), {"humidity": HUMIDITY})
    found = evaluate_modulator(
        model, strokes.pick(KNOWN), strokes.pick(TEST_SPLIT), left=left("width", "humidity"), seed=0
    )
    assert found.gain == pytest.approx(0.0, abs=0.01)
    constant = replace(strokes, covariates={"humidity": np.full(72, 0.4)})
    assert fit_modulator(model, constant, [("width", "humidity")], 0) == Modulator(())


def test_curve_is_linear_between_knots_and_constant_beyond(
    humid: tuple[Model, Measured],
) -> None:
    curve = Curve("width", "humidity", np.array([0.0, 1.0, 3.0]), np.array([1.0, 2.0, -2.0]))
    values = np.array([-5.0, 0.0, 0.5, 2.0, 3.0, 9.0, np.nan])
    strokes = replace(humid[1].pick(np.arange(7)), covariates={"humidity": values})
    found = Modulator((curve, curve)).amounts(strokes)
    np.testing.assert_allclose(found[:, MODES.index("width")], 2 * np.array([1, 1, 1.5, 0, -2, -2, 0]))
    assert not found[:, MODES.index("normal")].any()


def test_constant_modulation_equals_all_modes(humid: tuple[Model, Measured]) -> None:
    """Modulation with a constant column equals the mechanism of all modes with that value."""
    model, strokes = humid
    even = model.base * (np.array(BASE) != "edge_by_press")  # bleeding knows no harder edge than the base's usual one
    model = replace(model, base=even)
    amounts = torch.tensor([0.1, -0.2, 3e-4, -2e-4, 1e-4, 5e-4, 0.3], dtype=torch.float64)
    columns = {f"modulation_{mode}": np.full(72, float(amount)) for mode, amount in zip(MODES, amounts, strict=True)}
    own = mark_px(model.plus(AllModes(amounts, {})), strokes)
    nothing = torch.zeros(len(MODES), dtype=torch.float64)
    read = mark_px(model.plus(Modulation(nothing, {})), replace(strokes, covariates=columns))
    np.testing.assert_allclose(read, own, rtol=1e-6)
    valued = mark_px(model.plus(Modulation(amounts, {})), strokes)
    np.testing.assert_allclose(valued, own, rtol=1e-6)


def test_empty_modulator_is_the_identity(humid: tuple[Model, Measured]) -> None:
    model, strokes = humid
    assert abs(model.base[BASE.index("edge_by_press")]) > 0.01
    same = modulated(model, Modulator(()), strokes)
    np.testing.assert_allclose(residual(*same), residual(model, strokes), atol=1e-6)
