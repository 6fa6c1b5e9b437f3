"""The engine on a toy simulator: it names what is hidden, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from pentimento.diagnosis.decision import FEATURES, features
from pentimento.diagnosis.diagnose import Result, diagnose
from pentimento.diagnosis.evidence import Evidence
from pentimento.diagnosis.simulator import FittedSimulator, SimulatorProblem
from pentimento.diagnosis.splits import split
from pentimento.diagnosis.verdict import verdict
from tests.diagnosis.spring import spring


def _diagnosed(problem: SimulatorProblem) -> Result[FittedSimulator]:
    return diagnose(problem, seed=0, log=lambda line: None)


def _names(result: Result[FittedSimulator]) -> set[str]:
    return {finding.cause for finding in result.established}


@pytest.mark.parametrize(
    ("hidden", "name"), [({"rate": 0.25}, "rate_stiffening"), ({"wear": 0.2}, "wear")], ids=["rate", "wear"]
)
def test_a_hidden_cause_is_named_although_its_form_is_another(hidden: dict[str, float], name: str) -> None:
    result = _diagnosed(spring(**hidden))
    assert _names(result) == {name}
    closed = result.gap_closed
    assert closed is not None
    assert closed[0] > 0.7


def test_two_hidden_causes_are_both_named() -> None:
    assert _names(_diagnosed(spring(rate=0.3, wear=0.25))) == {"rate_stiffening", "wear"}


def test_where_nothing_is_hidden_nothing_is_named() -> None:
    results = [_diagnosed(spring(seed=seed)) for seed in range(8)]
    assert not any(_names(result) for result in results)
    over_floor = [result.base_losses.mean() / result.floor.mse for result in results if result.floor]
    assert np.median(over_floor) == pytest.approx(1.0, abs=0.3)


def test_an_effect_without_a_name_is_reported_by_mode_and_covariate() -> None:
    result = _diagnosed(spring(warmth=0.05))
    assert not _names(result)
    assert ("log_stiffness", "temperature_c") in [(left.mode, left.covariate) for left in result.structure.unexplained]


def test_no_decision_depends_on_the_test_split() -> None:
    problem = spring(rate=0.25)
    noise = problem.measured.copy()
    test = split(problem.rows, 0).test
    noise[test] = np.random.default_rng(1).normal(size=noise[test].shape)
    one, other = _diagnosed(problem), _diagnosed(replace(problem, measured=noise))
    assert one.decided.probability == other.decided.probability
    assert other.established[0].gain < one.established[0].gain


def test_values_come_with_their_unit_and_error() -> None:
    (finding,) = _diagnosed(spring(rate=0.25)).established
    value, error = finding.values["per_speed"]
    # The slope of 1 + 0.25 tanh(0.6 v) between 0.5 and 3 m/s, relative to the stiffness at rest: 0.05 to 0.15 per m/s.
    assert 0.05 < value < 0.15
    assert 0 < error < value / 5


def test_the_verdict_is_complete() -> None:
    result = _diagnosed(spring(rate=0.25))
    content = verdict(result)
    assert content["established"][0]["cause"] == "rate_stiffening"
    assert set(content["established"][0]["evidence"]) == set(Evidence._fields)
    assert "rate_stiffening" in content["text"]
    assert content["mse"]["extended"] < content["mse"]["base"]


def test_features_are_bounded() -> None:
    wild = Evidence(*[1e9] * len(Evidence._fields))._replace(votes=1.0)
    assert np.abs(features(wild)).max() <= 8
    assert len(features(wild)) == len(FEATURES)
