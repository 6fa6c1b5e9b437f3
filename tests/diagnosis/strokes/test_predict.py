"""Predictions, their Jacobian, and fits that recover the generating parameters."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pentimento.contracts.colour import linear_to_srgb
from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.strokes.fit import first_model, fit
from pentimento.diagnosis.strokes.jacobian import linearise, linearise_rows
from pentimento.diagnosis.strokes.measured import Measured, load_measured
from pentimento.diagnosis.strokes.model import BASE, PRESSES, Model, UnevenEnds, identity, interpolate
from pentimento.diagnosis.strokes.predict import (
    ink,
    mark_px,
    marks_px,
    mean_squared_error,
    predicted,
    predicted_linear,
    residual,
)
from pentimento.dynamics.strokes.mechanisms import VOCABULARY
from pentimento.dynamics.strokes.mechanisms.ink_depletion import InkDepletion
from pentimento.dynamics.strokes.mechanisms.path_offset import PathOffset
from pentimento.dynamics.strokes.simulation import Mechanism, NotObservable, StrokeContext


@pytest.fixture(scope="module")
def measured() -> Measured:
    return load_measured(example_table(48))


def photographed(model: Model, measured: Measured) -> Measured:
    """The same strokes with photographs that the model predicts exactly."""
    after = linear_to_srgb(predicted_linear(ink(model, measured), measured))
    return replace(measured, samples=measured.samples._replace(after=torch.from_numpy(after)))


def with_all_causes(measured: Measured) -> Model:
    found: list[Mechanism] = [identity(UnevenEnds, measured.context)]
    for kind in VOCABULARY:
        try:
            found.append(identity(kind, measured.context))
        except NotObservable:
            continue
    return first_model(measured).plus(*found)


def test_half_width_curve_interpolates_knots_and_extrapolates() -> None:
    knots = torch.tensor(PRESSES, dtype=torch.float64)
    values = torch.tensor(np.random.default_rng(0).uniform(1, 2, len(PRESSES)))
    torch.testing.assert_close(interpolate(values, knots), values)
    line = 1.0 + 0.5 * knots
    beyond = torch.tensor([-0.3, -0.01, 0.2, 0.73, 1.0, 1.4], dtype=torch.float64)
    torch.testing.assert_close(interpolate(line, beyond), 1.0 + 0.5 * beyond)
    first, last = np.diff(PRESSES)[[0, -1]]
    assert PRESSES[0] == 0 and PRESSES[-1] == pytest.approx(1) and 3 * first < last


def test_batched_marks_equal_single_marks(measured: Measured) -> None:
    few = measured.pick(np.arange(3))
    model = with_all_causes(measured)
    rng = np.random.default_rng(1)
    vectors = model.vector + 0.03 * rng.normal(size=(4, len(model.vector)))
    at_once = marks_px(model, model.mechanisms, vectors, few)
    np.testing.assert_allclose(at_once, [mark_px(model.at(vector), few) for vector in vectors], rtol=1e-9)


def test_prediction_without_ink_is_the_photograph_before(measured: Measured) -> None:
    few = measured.pick(np.arange(3))
    for model in (first_model(measured), with_all_causes(measured)):
        moved = model.at(model.vector + 0.03 * (np.arange(len(model.vector)) >= model.nuisances))
        whole = linear_to_srgb(predicted_linear(ink(moved, few), few))
        np.testing.assert_allclose(predicted(moved, few), whole, atol=2e-6)


def test_prediction_is_independent_of_other_strokes(measured: Measured) -> None:
    model = with_all_causes(measured)
    model = model.at(model.vector + 0.1 * (np.arange(len(model.vector)) >= model.nuisances))
    for own in (slice(5, 6), np.array([5])):
        np.testing.assert_array_equal(mark_px(model, measured.pick(own))[0], mark_px(model, measured)[5])


def test_prediction_at_pixels_equals_whole_image(measured: Measured) -> None:
    few = measured.pick(np.arange(3))
    for model in (first_model(measured), with_all_causes(measured)):
        moved = model.at(model.vector + 0.03 * (np.arange(len(model.vector)) >= model.nuisances))
        laid = ink(moved, few)
        seen = laid.footprint.segment >= 0
        some = predicted_linear(laid, few, np.flatnonzero(seen))
        np.testing.assert_array_equal(some, predicted_linear(laid, few)[seen])


def test_jacobian_equals_finite_differences(measured: Measured) -> None:
    few = measured.pick(np.arange(4))
    model = with_all_causes(measured)
    rng = np.random.default_rng(0)
    model = model.at(model.vector + 0.03 * rng.normal(size=len(model.vector)))
    curvature, slope, energy = linearise_rows(model, few)
    step, size = 1e-3, len(model.vector)
    numeric = np.stack(
        [
            (residual(model.at(model.vector - e), few) - residual(model.at(model.vector + e), few)) / (2 * step)
            for e in step * np.eye(size)
        ]
    ).reshape(size, 4, -1)
    pixels = few.samples.valid.numpy().sum((1, 2)) * 3
    norms = np.sqrt(np.square(numeric).sum(-1).T / pixels[:, None])
    seen = norms > 0.02 * norms.max()
    exact = np.sqrt(np.einsum("bpp->bp", curvature))
    np.testing.assert_allclose(exact[seen], norms[seen], rtol=0.15)
    rest = residual(model, few).reshape(4, -1)
    np.testing.assert_allclose(energy, np.square(rest).sum(1) / pixels, rtol=1e-4)
    expected = np.einsum("pbx,bx->bp", numeric, rest) / pixels[:, None]
    assert np.corrcoef(slope[seen], expected[seen])[0, 1] > 0.99


def test_action_statistics_are_means_over_rows(measured: Measured) -> None:
    model = first_model(measured)
    twice = measured.pick(np.repeat(np.arange(6), 2))
    one, two = linearise(model, measured.pick(np.arange(6))), linearise(model, twice)
    for a, b in zip(one, two, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-12)


def test_fit_recovers_the_generating_parameters(measured: Measured) -> None:
    base = fit(first_model(measured), measured)
    true = base.plus(
        InkDepletion(torch.tensor([0.4, 0.1], dtype=torch.float64), InkDepletion.reference_of(measured.context)),
        PathOffset(torch.tensor([4e-4, -3e-4], dtype=torch.float64), {}),
    )
    observed = photographed(true, measured)
    start = first_model(observed).plus(*(identity(type(m), observed.context) for m in true.mechanisms))
    found, plain = fit(start, observed), fit(first_model(observed), observed)
    error, without = (mean_squared_error(residual(m, observed), observed).mean() for m in (found, plain))
    assert error < 0.02 * without
    np.testing.assert_allclose(found.mechanisms[0].values, true.mechanisms[0].values, atol=0.03)
    np.testing.assert_allclose(found.mechanisms[1].values, true.mechanisms[1].values, atol=2e-5)


def test_fit_never_increases_the_loss(measured: Measured) -> None:
    start = first_model(measured)
    losses = [float(mean_squared_error(residual(m, measured), measured).mean()) for m in (start, fit(start, measured))]
    assert losses[1] < losses[0]


def test_model_and_vector_round_trip(measured: Measured) -> None:
    model = with_all_causes(measured)
    vector = model.vector + np.arange(len(model.vector))
    np.testing.assert_allclose(model.at(vector).vector, vector)
    columns = np.concatenate([model.columns_of(m.cause) for m in model.mechanisms])
    np.testing.assert_array_equal(columns, np.arange(len(BASE) + model.color_offset.size, len(vector)))
    assert model.without("uneven_ends").vector.size == len(vector) - 4


@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_base_can_shift_outwards_in_bends(measured: Measured, turn: float) -> None:
    angle = torch.linspace(0, 3, 40, dtype=torch.float64) * turn
    path = torch.zeros(1, 1, 40, 5, dtype=torch.float64)
    path[..., 1], path[..., 2] = 0.02 * torch.cos(angle), 0.02 * torch.sin(angle)
    plain = first_model(measured)
    vector = plain.vector.copy()
    vector[BASE.index("outward_mm")] = 0.3
    points = [model.mark(StrokeContext(path, {})).points_m for model in (plain, plain.at(vector))]
    outward_m = ((points[1] - points[0]) * path[..., 1:3] / 0.02).sum(-1)
    torch.testing.assert_close(outward_m, torch.full_like(outward_m, 3e-4), rtol=5e-3, atol=0)
