"""Decisions on found causes: borderline candidates, confirmation, look-alikes, signatures, parsimony."""

from __future__ import annotations

import numpy as np
import pytest

from pentimento.diagnosis.pushes.establish import (
    confirmations,
    depends_on_time,
    lookalike_is_as_good,
    shows_signature,
    varies_by_place,
    with_one_borderline,
)
from pentimento.diagnosis.pushes.fit import fit
from pentimento.diagnosis.pushes.jacobian import action_losses
from pentimento.diagnosis.pushes.measured import MeasuredPushes, measure
from pentimento.diagnosis.pushes.search import Search, observable_causes
from pentimento.diagnosis.score import Evidence, Step
from pentimento.dynamics.pushes.analytic import first_model
from pentimento.dynamics.pushes.mechanisms.far_field import FarField
from pentimento.dynamics.pushes.mechanisms.height_offset import HeightOffset
from pentimento.dynamics.pushes.mechanisms.lookalikes import ClosedStart, LowerRims, Sinking
from pentimento.dynamics.pushes.mechanisms.mechanism import Mechanism
from pentimento.dynamics.pushes.mechanisms.springback import Springback
from pentimento.dynamics.pushes.mechanisms.tool_backlash import ToolBacklash
from pentimento.dynamics.pushes.mechanisms.volume_loss import VolumeLoss
from tests.dynamics.pushes.played_pushes import blank, mechanism, played

ACTIONS = 32
BACKLASH_M = 0.0006
KINDS = (FarField, ToolBacklash)
WEAKLY = {"kept_by_compression": 0.2, "kept_by_log_dwell": 0.06}


def pushes(backlash_m: float) -> MeasuredPushes:
    """A session whose tool has backlash along x."""
    return measure(played([mechanism(ToolBacklash, blank(ACTIONS), x_m=backlash_m)], ACTIONS))


def halves(measured: MeasuredPushes) -> tuple[MeasuredPushes, np.ndarray]:
    """The discovery pushes, and the mask of the test actions."""
    test_actions = np.unique(measured.action) % 2 == 1
    return measured.pick(np.flatnonzero(measured.action % 2 == 0)), test_actions


def ended(discovery: MeasuredPushes, backlash_p: float, minimum: float = 0.0) -> Search:
    """A search without findings, with this minimum fall of error, mm²."""
    observable, _ = observable_causes(discovery, KINDS)
    base = fit(first_model(discovery.scene), discovery)
    evidence = {
        "tool_backlash": Evidence(backlash_p, backlash_p, 0.1, (0.0, 0.2), 0.0),
        "far_field": Evidence(0.2, 0.2, 0.2, (0.0, 0.3), 0.0),  # larger gain in the search, but no effect
    }
    return Search(base, base, (Step(evidence, None, ()),), observable, {}, dict.fromkeys(observable, minimum))


@pytest.fixture(scope="module")
def with_backlash() -> MeasuredPushes:
    return pushes(BACKLASH_M)


@pytest.mark.parametrize(
    ("backlash_p", "minimum", "named"),
    [
        (0.1, 0.0, True),
        (0.4, 0.0, False),  # the test split would be the only evidence
        (0.1, 1.0, False),  # below the minimum fall of error
    ],
)
def test_borderline_candidate_is_added_if_test_split_supports_it(
    with_backlash: MeasuredPushes, backlash_p: float, minimum: float, named: bool
) -> None:
    discovery, test_actions = halves(with_backlash)
    begun = ended(discovery, backlash_p, minimum)
    found = with_one_borderline(begun, discovery, with_backlash, test_actions, seed=0, log=lambda line: None)
    assert found.found == ({"tool_backlash"} if named else frozenset())
    if named:
        assert [step.chosen for step in found.steps] == ["tool_backlash", None]
        assert found.steps[0].evidence["tool_backlash"].p_adjusted < 0.003


def test_borderline_candidate_is_rejected_if_test_split_contradicts_it(with_backlash: MeasuredPushes) -> None:
    """The test pushes were recorded without backlash."""
    discovery, test_actions = halves(with_backlash)
    others = pushes(0.0)
    begun = ended(discovery, 0.1)
    model = fit(begun.model.plus(begun.observable["tool_backlash"]), discovery)
    assert confirmations(model, others, test_actions, 0)["tool_backlash"] > 0.1
    assert with_one_borderline(begun, discovery, others, test_actions, seed=0, log=lambda line: None) is begun


def test_confirmation_depends_on_direction_of_effect(with_backlash: MeasuredPushes) -> None:
    discovery, test_actions = halves(with_backlash)
    begun = ended(discovery, 0.1)
    model = fit(begun.model.plus(begun.observable["tool_backlash"]), discovery)
    assert confirmations(model, with_backlash, test_actions, 0)["tool_backlash"] < 0.01
    own = np.isin(np.arange(len(model.vector)), model.columns_of("tool_backlash"))
    other_way = model.at(np.where(own, -model.vector, model.vector))
    assert confirmations(other_way, with_backlash, test_actions, 0)["tool_backlash"] > 0.5
    assert confirmations(begun.model, with_backlash, test_actions, 0) == {}


@pytest.mark.parametrize(
    ("named", "hidden", "as_good"),
    [
        (Springback, [(Sinking, {"by_log_dwell": 0.08})], True),
        (
            Springback,
            [(Sinking, {"by_log_dwell": 0.04}), (Springback, WEAKLY)],
            True,
        ),  # the look-alike explains nearly all
        (Springback, [(Springback, {"kept_by_log_dwell": 0.15})], False),
        (FarField, [(LowerRims, {"share": 0.3})], True),
        (FarField, [(FarField, {"share": 0.3})], False),
        (HeightOffset, [(ClosedStart, {"less_deep_m": 0.001})], True),
        (HeightOffset, [(HeightOffset, {"lower_m": -0.001})], False),
        (HeightOffset, [(HeightOffset, {"lower_m": 0.001})], False),
        (VolumeLoss, [(LowerRims, {"share": 0.3})], False),  # volume loss itself lowers the rims
    ],
)
def test_lookalike_replaces_cause_only_if_as_good(
    named: type[Mechanism], hidden: list[tuple[type[Mechanism], dict[str, float]]], as_good: bool
) -> None:
    measured = measure(played([mechanism(kind, blank(), **values) for kind, values in hidden]))
    known, _ = observable_causes(measured, [named])
    base = fit(first_model(measured.scene), measured)
    model = fit(base.plus(known[named.cause]), measured)
    assert action_losses(model, measured).mean() < action_losses(base, measured).mean()
    assert lookalike_is_as_good(named.cause, model, measured, 0) == as_good


@pytest.mark.parametrize(
    ("times", "compression", "dwell", "shown"),
    [
        (["dwell_s"], (-2.0, 0.2), (0.0, 0.02), False),  # as with sliding walls
        (["dwell_s"], (0.5, 0.2), (0.0, 0.02), False),  # as with any wrong depths of the base
        (["dwell_s"], (-0.5, 0.2), (0.1, 0.02), True),
        (["dwell_s", "until_scan_s"], (0.3, 0.2), (0.03, 0.02), False),
        ([], (0.5, 0.2), (0.0, 0.02), True),  # no other quantity is observable
        ([], (-2.0, 0.2), (0.0, 0.02), False),
    ],
)
def test_springback_signature(
    times: list[str], compression: tuple[float, float], dwell: tuple[float, float], shown: bool
) -> None:
    values = {"kept_by_compression": compression, "kept_by_log_dwell": dwell, "recovered_by_log_time": (0.0, 0.1)}
    assert shows_signature(Springback(np.zeros(3), dict.fromkeys(times, 1.0)), values) == shown


@pytest.mark.parametrize(
    ("times", "dwell", "does"),
    [(["dwell_s"], (0.18, 0.01), True), (["dwell_s"], (0.03, 0.01), False), ([], (0.18, 0.01), False)],
)
def test_certain_dependence_on_time_excludes_aliasing(times: list[str], dwell: tuple[float, float], does: bool) -> None:
    values = {"kept_by_compression": (2.0, 0.1), "kept_by_log_dwell": dwell, "recovered_by_log_time": (0.0, 0.1)}
    assert depends_on_time(Springback(np.zeros(3), dict.fromkeys(times, 1.0)), values) == does
    assert not depends_on_time(mechanism(FarField, blank()), {"share": (0.3, 0.01)})


@pytest.mark.parametrize(
    ("lower", "to_the_right", "to_the_top", "does"),
    [
        ((0.6e-3, 0.07e-3), (0.1e-3, 0.1e-3), (0.0, 0.1e-3), False),  # as with wrong shallow depths of the base
        ((0.0, 0.1e-3), (0.3e-3, 0.1e-3), (-0.3e-3, 0.1e-3), True),  # jointly significant
        ((0.0, 0.1e-3), (0.3e-3, 0.1e-3), (0.0, 0.1e-3), False),
        ((0.0, 0.1e-3), (-0.4e-3, 0.1e-3), (0.0, 0.0), True),  # all starts on one line
    ],
)
def test_certain_variation_by_place_excludes_aliasing(
    lower: tuple[float, float], to_the_right: tuple[float, float], to_the_top: tuple[float, float], does: bool
) -> None:
    values = {"lower_m": lower, "lower_to_the_right_m": to_the_right, "lower_to_the_top_m": to_the_top}
    assert varies_by_place(mechanism(HeightOffset, blank()), values) == does
    assert not varies_by_place(mechanism(FarField, blank()), {"share": (0.3, 0.01)})


def test_cause_without_signature_always_shows_it() -> None:
    assert shows_signature(mechanism(FarField, blank()), {"share": (0.01, 0.2)})
