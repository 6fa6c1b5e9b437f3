"""Diagnosis of pushes in matched worlds: the cause, its size, the gap, and the verdict."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.diagnosis.evaluation import Floor
from pentimento.diagnosis.pushes.diagnose import diagnose
from pentimento.diagnosis.pushes.establish import _sure_causes, is_superfluous
from pentimento.diagnosis.pushes.measured import measure
from pentimento.diagnosis.pushes.search import observable_causes
from pentimento.diagnosis.score import Evidence, Step
from pentimento.diagnosis.verdict import PUSHES, Finding, verdict
from pentimento.dynamics.pushes.mechanisms import Mechanism
from pentimento.dynamics.pushes.mechanisms.far_field import FarField
from pentimento.dynamics.pushes.mechanisms.tool_backlash import ToolBacklash
from studies.blind.pushes.collect import as_table, decoys, recorded_rows
from studies.blind.pushes.verdict_of import verdict_on
from studies.blind.pushes.worlds import sketch_world
from tests.diagnosis.pushes.conftest import LOST, Played
from tests.dynamics.pushes.played_pushes import blank

WORLDS: tuple[tuple[int, str | None, float], ...] = ((1, "tool_backlash", 1.5), (4, None, 0.0))
"""Seed, hidden cause, its strength."""


def test_establishes_only_hidden_cause(lossy: Played) -> None:
    assert [finding.cause for finding in lossy.diagnosis.established] == ["volume_loss"]


def test_estimates_size_of_cause_within_error(lossy: Played) -> None:
    (found,) = lossy.diagnosis.established
    value, error = found.values["lost_share"]
    assert 0 < error < 0.1
    assert value == pytest.approx(LOST, abs=max(4 * error, 0.05))


def test_closes_most_of_gap_to_noise_floor(lossy: Played) -> None:
    found = lossy.diagnosis
    assert found.floor is not None and found.gap_closed is not None
    assert found.base_losses.mean() > 1.5 * found.floor.mse
    assert found.gap_closed[0] > 0.8


def test_splits_cover_all_actions_once(lossy: Played) -> None:
    parts, action = lossy.diagnosis.splits, lossy.measured.action
    discovery, test = set(action[parts.discovery]), set(action[parts.test])
    assert not discovery & test and discovery | test == set(action)
    assert len(lossy.diagnosis.base_losses) == len(test) == round(0.2 * len(set(action)))


@pytest.mark.parametrize(
    ("p_discovery", "p_test", "sure"),
    [
        (0.04, 0.005, True),  # test split alone
        (0.04, 0.05, False),
        (0.001, 0.05, True),  # both together
        (0.001, 0.1, False),
    ],
)
def test_scores_of_both_splits_combine_to_certainty(
    lossy: Played, p_discovery: float, p_test: float, sure: bool
) -> None:
    found = lossy.diagnosis.search
    evidence = Evidence(p_discovery, p_discovery, 0.1, (0.0, 0.2), 0.0)
    found = replace(found, steps=(Step({"volume_loss": evidence}, "volume_loss", ()), Step({}, None, ())))
    assert _sure_causes(found, {"volume_loss": p_test}) == ({"volume_loss"} if sure else set())
    borderline = replace(found, steps=(Step({"volume_loss": evidence}, None, ()),))
    assert _sure_causes(borderline, {"volume_loss": p_test}) == ({"volume_loss"} if sure else set())


def test_only_certain_errors_drop_confirmed_cause_that_is_not_aliasable() -> None:
    known, _ = observable_causes(measure(blank(12, 1), 0.006), [FarField, ToolBacklash])
    far, backlash = known["far_field"], known["tool_backlash"]
    unsure = Finding("tool_backlash", 0.003, 0.06, -0.02, (-0.5, 0.6), {}, ())

    def dropped(finding: Finding, mechanism: Mechanism) -> bool:
        return is_superfluous(finding, mechanism, 1.0, None, losses=np.ones(8), sure=False)

    assert dropped(unsure, far) and not dropped(unsure, backlash)
    assert dropped(replace(unsure, gain_interval=(-0.5, -0.01)), backlash)
    assert dropped(replace(unsure, confirmed_p=0.3), backlash)


@pytest.mark.parametrize(
    ("sure", "left", "minimum"),
    [
        (False, 1.1, 0.025),
        (False, 3.2, 0.8),
        (True, 1.1, 0.0125),
        (True, 3.2, 0.8),
    ],  # 0.8: 0.4 of what is left for sure
)
def test_aliasable_cause_must_remove_minimum_error(sure: bool, left: float, minimum: float) -> None:
    known, _ = observable_causes(measure(blank(12, 1), 0.006), [FarField])
    floor = Floor(1.0, (0.8, 1.2))
    for gain, superfluous in ((0.99 * minimum, True), (1.01 * minimum, False)):
        finding = Finding("far_field", 0.003, 0.06, gain, (0.0, 1.0), {}, ())
        losses = np.full(8, left)
        assert is_superfluous(finding, known["far_field"], 1.0, floor, losses=losses, sure=sure) == superfluous


def test_rejects_too_few_actions(lossy: Played) -> None:
    few = lossy.measured.pick(np.flatnonzero(lossy.measured.action < 6))
    with pytest.raises(ContractError, match="different actions"):
        diagnose(few, (), 0, log=lambda line: None)


def test_verdict_names_pushes_and_square_millimetres(lossy: Played) -> None:
    result = verdict(lossy.diagnosis, len(lossy.measured), 35, kind=PUSHES)
    assert result["kind"] == "pushes" and "mm²" in result["sentence"] and "strokes" not in result["sentence"]
    assert result["established"][0]["parameters"]["lost_share"]["value"] > 0


def hidden_and_named(seed: int, cause: str | None, strength: float) -> tuple[set[str], set[str]]:
    """Hidden causes of a world, and the causes that the verdict on its table establishes."""
    sketch = sketch_world("none" if cause is None else "one", seed, cause)
    small = replace(sketch, config=replace(sketch.config, pushes=60, repeated=9, times=2))
    rows = recorded_rows(small, small.with_strengths({} if cause is None else {cause: strength}), seed)
    result, _ = verdict_on(as_table(rows, decoys(len(rows), seed)), 0)
    return set(small.causes), {entry["cause"] for entry in result["established"]}


@pytest.mark.timeout(600)
def test_names_hidden_causes_of_small_simulated_worlds() -> None:
    found = [hidden_and_named(*world) for world in WORLDS]
    assert all(hidden == named for hidden, named in found), found
