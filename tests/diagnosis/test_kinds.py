"""Strokes and pushes keep the protocol of a problem."""

from typing import Any

import numpy as np
import pytest

from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.problem import Problem, columns_of
from pentimento.diagnosis.pushes.measured import measure
from pentimento.diagnosis.pushes.problem import push_problem
from pentimento.diagnosis.strokes.measured import load_measured
from pentimento.diagnosis.strokes.problem import stroke_problem
from pentimento.dynamics.strokes.mechanisms.ink_depletion import InkDepletion
from pentimento.dynamics.strokes.mechanisms.path_offset import PathOffset
from pentimento.planning.pushes.analytic.mechanisms.far_field import FarField
from pentimento.planning.pushes.analytic.mechanisms.volume_loss import VolumeLoss
from tests.dynamics.pushes.played_pushes import blank, mechanism, played


def _strokes() -> Problem[Any]:
    return stroke_problem(load_measured(example_table(24)), (InkDepletion, PathOffset), 0)


def _pushes() -> Problem[Any]:
    samples = played([mechanism(VolumeLoss, blank(16), lost_share=0.5)], 16)
    return push_problem(measure(samples), (VolumeLoss, FarField), 0)


@pytest.mark.parametrize(("problem", "cause"), [(_strokes, "ink_depletion"), (_pushes, "volume_loss")])
def test_statistics_are_those_of_the_fitted_model(problem: Any, cause: str) -> None:
    prepared = problem().prepared()
    model = prepared.fit((cause,))
    statistics = prepared.linearise(model, ())
    assert statistics.curvature.shape[1] == len(model.vector)
    assert len(columns_of(prepared, model, cause)) == len(prepared.causes[cause].quantities)
    # The energy of the linearisation is the error of the model.
    np.testing.assert_allclose(statistics.energy, prepared.losses(model), rtol=1e-3)


@pytest.mark.parametrize(("problem", "cause"), [(_strokes, "ink_depletion"), (_pushes, "volume_loss")])
def test_rows_of_a_part_are_the_rows_of_the_whole(problem: Any, cause: str) -> None:
    whole, picked = problem(), np.array([5, 1, 8])
    part, rows = whole.pick(picked), whole.rows.pick(picked)
    np.testing.assert_array_equal(part.rows.action, rows.action)
    np.testing.assert_array_equal(part.rows.block, rows.block)
    assert set(part.causes) == set(whole.causes) >= {cause}
