"""A matched world: the cause is named, its size is right, and the gap is closed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.diagnosis.evaluation import Floor
from pentimento.diagnosis.pushes.diagnose import _can_deny, _min_error, _only_surely_denied, _sure, diagnose
from pentimento.diagnosis.pushes.measured import measure
from pentimento.diagnosis.pushes.search import observable_causes
from pentimento.diagnosis.score import Evidence, Step
from pentimento.diagnosis.verdict import PUSHES, Finding, verdict
from pentimento.dynamics.pushes.mechanisms.far_field import FarField
from pentimento.dynamics.pushes.mechanisms.tool_backlash import ToolBacklash
from tests.diagnosis.pushes.conftest import LOST, Played
from tests.dynamics.pushes.played_pushes import blank


def test_the_hidden_cause_is_named_and_nothing_else(lossy: Played) -> None:
    assert [finding.cause for finding in lossy.diagnosis.established] == ["volume_loss"]


def test_its_size_is_known_within_its_error(lossy: Played) -> None:
    (found,) = lossy.diagnosis.established
    value, error = found.values["lost_share"]
    assert 0 < error < 0.1
    assert value == pytest.approx(LOST, abs=max(4 * error, 0.05))


def test_most_of_the_gap_is_closed_down_to_the_floor_of_the_repeats(lossy: Played) -> None:
    found = lossy.diagnosis
    assert found.floor is not None and found.gap_closed is not None
    assert found.base_losses.mean() > 1.5 * found.floor.mse
    assert found.gap_closed[0] > 0.8


def test_the_sealed_pushes_had_no_part_in_it(lossy: Played) -> None:
    parts, action = lossy.diagnosis.parts, lossy.measured.action
    discovery_split, test_split = set(action[parts.discovery_split]), set(action[parts.test_split])
    assert not discovery_split & test_split and discovery_split | test_split == set(action)
    assert len(lossy.diagnosis.base_losses) == len(test_split) == round(0.2 * len(set(action)))


@pytest.mark.parametrize(
    ("p_discovery", "p_test", "sure"),
    [
        (0.04, 0.005, True),  # sealed pushes alone
        (0.04, 0.05, False),
        (0.001, 0.05, True),  # both together
        (0.001, 0.1, False),
    ],
)
def test_scores_of_searched_and_sealed_pushes_can_be_sure_together(
    lossy: Played, p_discovery: float, p_test: float, sure: bool
) -> None:
    found = lossy.diagnosis.search
    evidence = Evidence(p_discovery, p_discovery, 0.1, (0.0, 0.2), 0.0)
    found = replace(found, steps=(Step({"volume_loss": evidence}, "volume_loss", ()), Step({}, None, ())))
    assert _sure(found, {"volume_loss": p_test}) == ({"volume_loss"} if sure else set())
    borderline = replace(found, steps=(Step({"volume_loss": evidence}, None, ()),))
    assert _sure(borderline, {"volume_loss": p_test}) == ({"volume_loss"} if sure else set())


def test_what_no_base_can_look_like_is_denied_only_by_errors_that_are_sure() -> None:
    known, _ = observable_causes(measure(blank(12, 1), 0.006), [FarField, ToolBacklash])
    far, backlash = known["far_field"], known["tool_backlash"]
    unsure = Finding("tool_backlash", 0.003, 0.06, -0.02, (-0.5, 0.6), {}, ())
    assert _can_deny(unsure, far) and not _can_deny(unsure, backlash)
    assert _can_deny(replace(unsure, gain_interval=(-0.5, -0.01)), backlash)
    assert not _only_surely_denied(False, 0.3)  # nor do their scores speak for it


def test_where_much_is_left_what_a_base_can_look_like_must_remove_much() -> None:
    """In a base that is wrong in many ways, something always looks a little like a cause."""
    floor = Floor(1.0, (0.8, 1.2))
    close, far = (_min_error(floor, np.full(8, left), False) for left in (1.1, 3.2))
    assert close == pytest.approx(0.025) and far == pytest.approx(0.4 * 2.0)


def test_and_no_scores_make_up_for_that_where_much_is_left() -> None:
    """They are as sure of what a base gets wrong; against noise they stand for half."""
    floor = Floor(1.0, (0.8, 1.2))
    close, far = (_min_error(floor, np.full(8, left), True) for left in (1.1, 3.2))
    assert close == pytest.approx(0.0125) and far == pytest.approx(0.4 * 2.0)


def test_too_few_actions_are_refused(lossy: Played) -> None:
    few = lossy.measured.pick(np.flatnonzero(lossy.measured.action < 6))
    with pytest.raises(ContractError, match="different actions"):
        diagnose(few, (), 0, lambda line: None)


def test_the_verdict_speaks_of_pushes_in_square_millimetres(lossy: Played) -> None:
    made = verdict(lossy.diagnosis, len(lossy.measured), 35, kind=PUSHES)
    assert made["kind"] == "pushes" and "mm²" in made["sentence"] and "strokes" not in made["sentence"]
    assert made["established"][0]["parameters"]["lost_share"]["value"] > 0
