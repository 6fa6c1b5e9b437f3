"""The same engine names causes of strokes and of pushes."""

from typing import Any

import numpy as np
import pytest

from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.decision import default_decision
from pentimento.diagnosis.diagnose import diagnose
from pentimento.diagnosis.problem import Problem, columns_of
from pentimento.diagnosis.pushes.problem import push_problem
from pentimento.diagnosis.rule import DecisionRule
from pentimento.diagnosis.strokes.problem import stroke_problem
from pentimento.diagnosis.pushes.measured import measure
from pentimento.diagnosis.strokes.measured import load_measured
from pentimento.dynamics.pushes.mechanisms.far_field import FarField
from pentimento.dynamics.pushes.mechanisms.tool_backlash import ToolBacklash
from pentimento.dynamics.pushes.mechanisms.volume_loss import VolumeLoss
from pentimento.dynamics.strokes.mechanisms.ink_depletion import InkDepletion
from pentimento.dynamics.strokes.mechanisms.path_offset import PathOffset
from pentimento.dynamics.strokes.mechanisms.speed_width import SpeedWidth
from tests.dynamics.pushes.played_pushes import blank, mechanism, played


def _strokes() -> Problem[Any]:
    return stroke_problem(load_measured(example_table(56)), (InkDepletion, PathOffset, SpeedWidth), 0)


def _pushes() -> Problem[Any]:
    samples = played([mechanism(VolumeLoss, blank(28), lost_share=0.5)], 28)
    return push_problem(measure(samples), (VolumeLoss, FarField, ToolBacklash), 0)


@pytest.mark.parametrize(("problem", "hidden"), [(_strokes, "ink_depletion"), (_pushes, "volume_loss")])
def test_the_hidden_cause_is_named(problem: Any, hidden: str) -> None:
    result = diagnose(problem(), default_decision(), DecisionRule(), seed=0, log=lambda line: None)
    found = (*result.established, *result.suspected)
    assert [finding.cause for finding in found] == [hidden]
    assert found[0].probability > 0.8
    assert found[0].gain > 0


@pytest.mark.parametrize(("problem", "cause"), [(_strokes, "ink_depletion"), (_pushes, "volume_loss")])
def test_statistics_are_those_of_the_fitted_model(problem: Any, cause: str) -> None:
    prepared = problem().prepared()
    model = prepared.fit((cause,))
    statistics = prepared.linearise(model, ())
    assert statistics.curvature.shape[1] == len(model.vector)
    assert len(columns_of(prepared, model, cause)) == len(prepared.causes[cause].quantities)
    # The energy of the linearisation is the error of the model.
    np.testing.assert_allclose(statistics.energy, prepared.losses(model), rtol=1e-3)
