"""Strokes as a problem of the diagnosis: possible values, starts of fits, the base's uneven ends."""

import numpy as np
import pytest

from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.problem import values_of
from pentimento.diagnosis.strokes.measured import load_measured
from pentimento.diagnosis.strokes.problem import StrokeProblem, stroke_problem, with_learned_residual
from pentimento.dynamics.strokes.mechanisms.bristle_lag import BristleLag
from pentimento.dynamics.strokes.mechanisms.latency import Latency
from pentimento.dynamics.strokes.mechanisms.lens_distortion import LensDistortion
from pentimento.dynamics.strokes.mechanisms.speed_density import SpeedDensity
from tests.diagnosis.strokes.conftest import Written
from tests.diagnosis.strokes.hidden import strokes_of


@pytest.fixture(scope="module")
def problem() -> StrokeProblem:
    return stroke_problem(load_measured(example_table(16)), (BristleLag, LensDistortion, SpeedDensity), 0)


@pytest.mark.parametrize(
    ("absorbed", "possible"), [(0.0, True), (2.0, True), (-0.3, True), (-0.8, False), (5.0, False)]
)
@pytest.mark.parametrize("cubic", [0.6, -0.6])
def test_lens_displaces_as_one_rectified_picture_can(
    problem: StrokeProblem, cubic: float, absorbed: float, possible: bool
) -> None:
    """``absorbed`` is the linear displacement at the strokes' edge, relative to the cubic one."""
    typical = [q.typical for q in problem.causes["lens_distortion"].quantities]
    values = np.array([cubic * typical[0], absorbed * cubic * typical[0]]) / typical
    assert problem.causes["lens_distortion"].allows(values) == possible


def test_linear_displacement_alone_is_no_lens(problem: StrokeProblem) -> None:
    assert not problem.causes["lens_distortion"].allows(np.array([0.01, 0.5]))


def test_lag_does_not_lead(problem: StrokeProblem) -> None:
    lag = problem.causes["bristle_lag"]
    assert lag.allows(np.array([0.5])) and not lag.allows(np.array([-0.5]))


def test_causes_have_their_signature_and_covariates(problem: StrokeProblem) -> None:
    assert problem.causes["speed_density"].signature == ("density_per_log_speed",)
    assert "speed_m_s" in problem.causes["speed_density"].covariates


def test_uneven_ends_compete_without_a_name(problem: StrokeProblem) -> None:
    assert [name for name, cause in problem.causes.items() if not cause.named] == ["uneven_ends"]


@pytest.mark.parametrize(("kind", "hidden"), [(BristleLag, 0.009), (Latency, 0.2)])
def test_fit_finds_displacement_larger_than_the_mark(kind: type[BristleLag] | type[Latency], hidden: float) -> None:
    """Beside fitted uneven ends, the derivative at 0 shows nothing of it."""
    strokes, _ = strokes_of(kind, hidden)
    prepared = stroke_problem(strokes, (kind,), 0).prepared()
    fitted = prepared.fit((kind.cause,), prepared.fit(("uneven_ends",)))
    found = values_of(prepared, fitted, kind.cause) * kind.quantities[0].typical
    assert found == pytest.approx(hidden, rel=0.1)


def test_learned_residual_of_all_strokes_is_that_of_their_splits(written: Written) -> None:
    learned, splits = with_learned_residual(written.result).residual_prediction, written.result.splits
    np.testing.assert_array_equal(learned[splits.test], written.result.test.measured.residual_prediction)
    known = np.sort(np.concatenate([splits.discovery, splits.confirmation]))
    np.testing.assert_array_equal(learned[known], written.result.known.measured.residual_prediction)
    assert np.abs(learned).max() > 0
