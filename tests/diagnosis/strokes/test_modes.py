"""Dependence of residual modes on covariates."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pentimento.contracts.colour import linear_to_srgb
from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.residual_structure import ModeScores, Structure, find_structure, permuted_actions
from pentimento.diagnosis.strokes.fit import first_model, fit
from pentimento.diagnosis.strokes.measured import Measured, covariates_shown, load_measured
from pentimento.diagnosis.strokes.model import Model
from pentimento.diagnosis.strokes.modes import MODES, AllModes, mode_scores
from pentimento.diagnosis.strokes.predict import ink, predicted_linear
from tests.diagnosis.strokes.hidden import swayed

AMOUNT = {"amplitude": 0.5, "width": 0.6, "normal": 1.5, "canvas_x": 1.5, "blur": 1.5}
"""In typical sizes, at one standard deviation of the temperature."""


@pytest.fixture(scope="module")
def strokes() -> tuple[Measured, Model]:
    measured = load_measured(example_table(72))
    return measured, fit(first_model(measured), measured)


def warmed(mode: str | None, measured: Measured, model: Model) -> Measured:
    """Photographs of strokes that depend on the temperature in one mode, with noise; a clock runs along with it."""
    rng = np.random.default_rng(5)
    warmth = rng.standard_normal(len(measured))
    columns = {"temperature_c": 20 + 3 * warmth, "clock_s": 60 * warmth + rng.normal(0, 15, len(measured))}
    plain = replace(measured, covariates=columns)
    amounts = np.zeros((len(measured), len(MODES)))
    if mode is not None:
        m = MODES.index(mode)
        amounts[:, m] = AMOUNT[mode] * warmth * AllModes.quantities[m].typical
    drawn, with_columns = swayed(model, plain, amounts)
    after = linear_to_srgb(predicted_linear(ink(drawn, with_columns), with_columns))
    after = np.clip(after + rng.normal(0, 0.01, after.shape), 0, 1).astype(np.float32)
    return replace(plain, samples=plain.samples._replace(after=torch.from_numpy(after)))


def structure_of(model: Model, measured: Measured) -> Structure:
    scores, columns = mode_scores(model, measured), covariates_shown(measured)
    return find_structure(MODES, scores, columns, action=measured.action, seed=0)


@pytest.mark.parametrize("mode", sorted(AMOUNT))
def test_reports_mode_with_driving_covariate_only(mode: str, strokes: tuple[Measured, Model]) -> None:
    measured, model = strokes
    strokes_then = warmed(mode, measured, model)
    structure = structure_of(model, strokes_then)
    left = structure.unexplained
    assert [(one.mode, one.covariate) for one in left[:1]] == [(mode, "temperature_c")]
    assert "clock_s" not in {one.covariate for one in left}
    assert structure.strength.shape == (len(MODES), len(structure.covariates))
    assert left[0].generic_gain > 0.01


def test_reports_nothing_without_structure(strokes: tuple[Measured, Model]) -> None:
    measured, model = strokes
    strokes_then = warmed(None, measured, model)
    assert structure_of(model, strokes_then).unexplained == ()


def test_weights_modes_by_their_energy() -> None:
    rng = np.random.default_rng(3)
    speed, rows = rng.standard_normal(160), np.arange(160)
    energy = np.where(rng.random(160) < 0.3, 1.0, 0.004)[:, None]  # what noise of 1 leaves of it is 1 / root of that
    scores = 1.2 * speed[:, None] + rng.standard_normal((160, 1)) / np.sqrt(energy)
    columns = {"speed": speed, "else": rng.standard_normal(160)}
    found, unweighted = (
        find_structure(("width",), ModeScores(scores, known, 1.0), columns, action=rows, seed=0)
        for known in (energy, np.ones_like(energy))
    )
    assert [one.covariate for one in found.unexplained] == ["speed"]
    assert not unweighted.unexplained and unweighted.strength[0, 0] < found.strength[0, 0]


def test_equal_energies_give_plain_correlation() -> None:
    rng = np.random.default_rng(4)
    speed = rng.standard_normal(90)
    scores = 0.2 * speed[:, None] + rng.standard_normal((90, 1))
    scored = ModeScores(scores, np.ones((90, 1)), 1.0)
    strength = find_structure(("width",), scored, {"speed": speed}, action=np.arange(90), seed=0).strength
    assert strength[0, 0] == pytest.approx(np.sqrt(90) * abs(np.corrcoef(speed, scores[:, 0])[0, 1]), rel=1e-6)


def test_permutations_keep_the_rows_of_an_action_together() -> None:
    action = np.array([4, 7, 7, 1, 9, 9, 2, 3, 3])
    orders = permuted_actions(action, 500, np.random.default_rng(0))
    assert (np.sort(orders, axis=1) == np.arange(len(action))).all()
    for number in (7, 9, 3):
        first, second = action[orders[:, action == number]].T
        assert (first == second).all()
    assert len(np.unique(orders, axis=0)) == 36  # 3! ways for the pairs, 3! for those alone
