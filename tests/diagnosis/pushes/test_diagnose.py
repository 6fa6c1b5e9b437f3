"""Diagnosis of pushes in matched worlds: the cause, its size, the gap, and the verdict."""

from __future__ import annotations

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.diagnosis.diagnose import diagnose
from pentimento.diagnosis.pushes.problem import push_problem, with_learned_residual
from pentimento.diagnosis.verdict import verdict
from pentimento.planning.pushes.analytic.mechanisms.slope_slide import SlopeSlide
from pentimento.planning.pushes.analytic.mechanisms.volume_loss import VolumeLoss
from tests.diagnosis.pushes.conftest import LOST, Played


def test_establishes_only_hidden_cause(lossy: Played) -> None:
    assert [finding.cause for finding in lossy.result.established] == ["volume_loss"]
    assert not lossy.result.suspected


def test_estimates_size_of_cause_within_error(lossy: Played) -> None:
    (found,) = lossy.result.established
    value, error = found.values["lost_share"]
    assert 0 < error < 0.1
    assert value == pytest.approx(LOST, abs=max(4 * error, 0.05))


def test_closes_most_of_gap_to_noise_floor(lossy: Played) -> None:
    found = lossy.result
    assert found.floor is not None and found.gap_closed is not None
    assert found.base_losses.mean() > 1.5 * found.floor.mse
    assert found.gap_closed[0] > 0.8


def test_learned_residual_of_all_pushes_is_that_of_their_splits(lossy: Played) -> None:
    learned, splits = with_learned_residual(lossy.result).learned_mm, lossy.result.splits
    np.testing.assert_array_equal(learned[splits.test], lossy.result.test.measured.learned_mm)
    known = np.sort(np.concatenate([splits.discovery, splits.confirmation]))
    np.testing.assert_array_equal(learned[known], lossy.result.known.measured.learned_mm)
    assert np.abs(learned).max() > 0


def test_rejects_too_few_actions(lossy: Played) -> None:
    few = lossy.measured.pick(np.flatnonzero(lossy.measured.action < 6))
    with pytest.raises(ContractError, match="different actions"):
        diagnose(push_problem(few, (VolumeLoss,), 0), seed=0, log=lambda line: None)


def test_verdict_names_pushes_and_square_millimetres(lossy: Played) -> None:
    content = verdict(lossy.result)
    assert content["kind"] == "pushes" and content["mse"]["unit"] == "mm²"
    assert "mm²" in content["text"] and "strokes" not in content["text"]
    assert (content["rows"], content["actions"]) == (len(lossy.measured), 35)
    assert content["established"][0]["parameters"]["lost_share"]["value"] > 0


def test_material_does_not_slide_uphill(lossy: Played) -> None:
    slide = push_problem(lossy.measured, (SlopeSlide,), 0).causes["slope_slide"]
    assert slide.allows(np.array([1.2, -0.3, 0.0])) and not slide.allows(np.array([0.3, -1.2, 0.0]))
