"""Causes that searched and sealed pushes ask for together."""

from __future__ import annotations

import numpy as np
import pytest

from pentimento.diagnosis.pushes.borderline import confirmations, with_one_borderline
from pentimento.diagnosis.pushes.fit import fit
from pentimento.diagnosis.pushes.measured import MeasuredPushes, measure
from pentimento.diagnosis.pushes.search import Search, observable_causes
from pentimento.diagnosis.score import Evidence, Step
from pentimento.dynamics.pushes.analytic import first_model
from pentimento.dynamics.pushes.mechanisms.far_field import FarField
from pentimento.dynamics.pushes.mechanisms.tool_backlash import ToolBacklash
from tests.dynamics.pushes.played_pushes import blank, mechanism, played

ACTIONS = 32
PLAY_M = 0.0006
KINDS = (FarField, ToolBacklash)


def pushes(play_m: float) -> MeasuredPushes:
    """A session whose tool has play to the right."""
    return measure(played([mechanism(ToolBacklash, blank(ACTIONS), x_m=play_m)], ACTIONS))


def halves(measured: MeasuredPushes) -> tuple[MeasuredPushes, np.ndarray]:
    """The pushes to search, and which actions of all are the others."""
    test_split = np.unique(measured.action) % 2 == 1
    return measured.pick(np.flatnonzero(measured.action % 2 == 0)), test_split


def ended(discovery_split: MeasuredPushes, backlash_p: float, minimum: float = 0.0) -> Search:
    """A search that has found nothing, whose causes must remove that much error, mm²."""
    observable, _ = observable_causes(discovery_split, KINDS)
    base = fit(first_model(discovery_split.scene), discovery_split)
    evidence = {
        "tool_backlash": Evidence(backlash_p, backlash_p, 0.1, (0.0, 0.2), 0.0),
        "far_field": Evidence(0.2, 0.2, 0.2, (0.0, 0.3), 0.0),  # promises more, and does nothing
    }
    return Search(base, base, (Step(evidence, None, ()),), observable, {}, dict.fromkeys(observable, minimum))


@pytest.fixture(scope="module")
def with_play() -> MeasuredPushes:
    return pushes(PLAY_M)


@pytest.mark.parametrize(
    ("backlash_p", "minimum", "named"),
    [
        (0.1, 0.0, True),
        (0.4, 0.0, False),  # sealed pushes would be the only witness
        (0.1, 1.0, False),  # that is too little
    ],
)
def test_what_is_in_doubt_is_taken_where_sealed_pushes_ask_for_it(
    with_play: MeasuredPushes, backlash_p: float, minimum: float, named: bool
) -> None:
    discovery_split, test_split = halves(with_play)
    begun = ended(discovery_split, backlash_p, minimum)
    found = with_one_borderline(begun, discovery_split, with_play, test_split, 0, lambda line: None)
    assert found.found == ({"tool_backlash"} if named else frozenset())
    if named:
        assert [step.chosen for step in found.steps] == ["tool_backlash", None]
        assert found.steps[0].evidence["tool_backlash"].p_adjusted < 0.003


def test_and_not_where_these_do_not(with_play: MeasuredPushes) -> None:
    """They were made before there was play."""
    discovery_split, test_split = halves(with_play)
    others = pushes(0.0)
    begun = ended(discovery_split, 0.1)
    model = fit(begun.model.plus(begun.observable["tool_backlash"]), discovery_split)
    assert confirmations(model, others, test_split, 0)["tool_backlash"] > 0.1
    assert with_one_borderline(begun, discovery_split, others, test_split, 0, lambda line: None) is begun


def test_confirmation_asks_for_the_cause_in_its_direction(with_play: MeasuredPushes) -> None:
    discovery_split, test_split = halves(with_play)
    begun = ended(discovery_split, 0.1)
    model = fit(begun.model.plus(begun.observable["tool_backlash"]), discovery_split)
    assert confirmations(model, with_play, test_split, 0)["tool_backlash"] < 0.01
    own = np.isin(np.arange(len(model.vector)), model.columns_of("tool_backlash"))
    other_way = model.at(np.where(own, -model.vector, model.vector))
    assert confirmations(other_way, with_play, test_split, 0)["tool_backlash"] > 0.5
    assert confirmations(begun.model, with_play, test_split, 0) == {}
