"""Coverage of confidence intervals, for worlds of the mechanisms' own functional form."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pentimento.contracts.colour import linear_to_srgb
from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.diagnose import values_with_errors
from pentimento.diagnosis.gauss_newton import Statistics, covariance
from pentimento.diagnosis.strokes.fit import first_model, fit
from pentimento.diagnosis.strokes.measured import Measured, load_measured
from pentimento.diagnosis.strokes.model import Model, identity
from pentimento.diagnosis.strokes.modes import MODES, AllModes
from pentimento.diagnosis.strokes.predict import ink, predicted_linear
from pentimento.diagnosis.strokes.problem import FittedStrokes, stroke_problem
from pentimento.dynamics.strokes.mechanisms.ink_depletion import InkDepletion
from pentimento.dynamics.strokes.mechanisms.path_offset import PathOffset
from pentimento.dynamics.strokes.mechanisms.speed_width import SpeedWidth
from tests.diagnosis.strokes.hidden import swayed

WORLDS = 14
KINDS = (PathOffset, InkDepletion, SpeedWidth)


def photographed(truth: Model, measured: Measured, seed: int) -> Measured:
    """As the truth has it, with noise of pixels, and each stroke a little darker, wider and aside of itself."""
    rng = np.random.default_rng([seed, 1])
    typical = np.array([quantity.typical for quantity in AllModes.quantities])
    amounts = rng.normal(0, 0.3, (len(measured), len(MODES))) * typical
    swaying, with_columns = swayed(truth, measured, amounts)
    after = linear_to_srgb(predicted_linear(ink(swaying, with_columns), with_columns))
    after = np.clip(after + rng.normal(0, 0.015, after.shape), 0, 1).astype(np.float32)
    return replace(measured, samples=measured.samples._replace(after=torch.from_numpy(after)))


def test_95_percent_intervals_cover_the_truth() -> None:
    whole = load_measured(example_table(96))
    start = fit(first_model(whole), whole)
    held = total = 0
    for seed in range(WORLDS):
        rng = np.random.default_rng([seed, 2])
        measured = whole.pick(np.sort(rng.choice(len(whole), 60, replace=False)))
        plain = start.plus(*(identity(kind, whole.context) for kind in KINDS))
        true = plain.vector.copy()
        true[plain.nuisances :] = rng.uniform(0.3, 1.0, len(true) - plain.nuisances)  # of what is typical
        truth = plain.at(true)
        problem = stroke_problem(photographed(truth, measured, seed), KINDS, seed)
        fitted = FittedStrokes(fit(plain, problem.measured))
        for hidden in truth.mechanisms:
            found = values_with_errors(problem, fitted, hidden.cause)
            for (value, error), true_value in zip(found.values(), hidden.values.tolist(), strict=True):
                held += abs(value - true_value) < 1.96 * error
                total += 1
    assert total >= 60
    assert 0.88 <= held / total <= 0.99, f"{held} of {total}"


@pytest.mark.parametrize("units", [(1.0, 1.0, 1.0), (1.0, 300.0, 1e-3)])
def test_covariance_equals_leave_one_out_changes_in_any_units(units: tuple[float, ...]) -> None:
    """Of least squares that is exact, also where one action alone decides one of the numbers."""
    rng = np.random.default_rng(3)
    columns = rng.normal(size=(12, 5, 3)) * units
    columns[1:, :, 2] = 0.0
    values = rng.normal(size=(12, 1)) + 0.1 * rng.normal(size=(12, 5))

    def slopes(actions: np.ndarray) -> np.ndarray:
        return np.linalg.lstsq(columns[actions].reshape(-1, 3), values[actions].ravel(), rcond=None)[0]

    every = np.arange(12)
    best = slopes(every)
    left = values - columns @ best
    statistics = Statistics(columns.mT @ columns, np.einsum("npi,np->ni", columns, left), np.square(left).sum(1))
    changes = np.stack([slopes(np.delete(every, action)) - best for action in every])[:, :2]
    assert np.allclose(covariance(statistics)[:2, :2], changes.T @ changes, rtol=1e-6)
