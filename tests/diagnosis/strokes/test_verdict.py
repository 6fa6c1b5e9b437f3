"""The verdict in schema 2 and as text."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from pentimento.diagnosis.evidence import Evidence
from pentimento.diagnosis.mechanistic import FittedModel
from pentimento.diagnosis.residual_structure import Structure, Unexplained
from pentimento.diagnosis.strokes.problem import StrokeProblem, StrokeResult
from pentimento.diagnosis.temporal_drift import TemporalDrift
from pentimento.diagnosis.verdict import text, verdict
from pentimento.dynamics.strokes.mechanisms.bristle_lag import BristleLag
from pentimento.dynamics.strokes.mechanisms.speed_width import SpeedWidth
from tests.diagnosis.strokes.conftest import FOUND, Written

KEYS = [
    "schema", "kind", "rows", "actions", "mse", "established", "suspected", "gap_closed", "unexplained",
    "floor_reached", "text",
]  # fmt: skip


def with_structure(result: StrokeResult, *left: Unexplained) -> StrokeResult:
    return replace(result, structure=Structure(left, np.zeros((7, 0)), ()), drift=None)


def test_verdict_has_the_keys_of_schema_2(written: Written) -> None:
    content = verdict(replace(written.result, drift=None))
    assert list(content) == KEYS
    assert (content["schema"], content["kind"], content["rows"], content["actions"]) == (2, "strokes", 56, 42)
    assert list(content["mse"]) == ["unit", "base", "extended", "floor", "floor_ci"]
    assert list(content["gap_closed"]) == ["test", "ci", "shifted"]
    json.dumps(content, allow_nan=False)


def test_finding_has_evidence_quantities_and_rivals(written: Written) -> None:
    found = replace(written.result, established=(FOUND,))
    entry = verdict(found)["established"][0]
    assert list(entry) == ["cause", "probability", "gain", "gain_ci", "parameters", "rivals", "evidence"]
    assert entry["parameters"] == {"distance_m": {"value": 0.0042, "se": 0.0003}}
    assert entry["probability"] == 0.97 and entry["gain_ci"] == [0.2, 0.6] and entry["rivals"] == ["latency"]
    assert tuple(entry["evidence"]) == Evidence._fields
    words = text(found)
    assert "Established: bristle_lag (probability 0.97): distance 4.2 ± 0.3 mm; removes 41% of the gap.\n" in words
    assert "Not told apart by this table: bristle_lag from latency." in words


def test_suspected_causes_are_separate(written: Written) -> None:
    words = text(replace(written.result, established=(), suspected=(replace(FOUND, probability=0.6),)))
    assert "No known cause is established.\nSuspected: bristle_lag (probability 0.6): " in words
    assert "Not told apart by this table: bristle_lag from latency." in words


def test_floor_and_gap_are_unknown_without_repeats(written: Written) -> None:
    content = verdict(replace(written.result, floor=None, established=(FOUND,)))
    assert content["mse"]["floor"] is None and content["mse"]["floor_ci"] is None
    assert content["floor_reached"] is None and content["gap_closed"]["test"] is None
    assert "floor is unknown" in content["text"] and "removes 41% of the error" in content["text"]


def test_verdict_reports_temporal_drift(written: Written) -> None:
    drift = TemporalDrift("width", 0.0005, 3e-5, 2e-5, np.zeros(56))
    drifting = replace(with_structure(written.result), drift=drift, established=())
    assert "width drifts" in text(drifting)
    assert verdict(drifting)["drift"] == {"mode": "width", "p": 0.0005, "mse": 3e-5, "mse_of_repeats": 2e-5}
    known = replace(with_structure(written.result, Unexplained("width", "temperature_c", 0.001, 0.2)), drift=drift)
    assert "drifts" not in text(known)


def test_structure_of_an_established_covariate_is_attributed_to_it(written: Written) -> None:
    """A law of another form leaves some of its own effect; "no cause explains it" would suggest an unknown one."""
    left = replace(with_structure(written.result, Unexplained("width", "speed_m_s", 0.001, 0.2)), suspected=())
    model = left.base.model
    slowed = model.plus(*(kind(torch.zeros(len(kind.quantities)), {}) for kind in (SpeedWidth, BristleLag)))
    assert "depends on speed_m_s; no known cause" in text(replace(left, extended=FittedModel(model)))
    words = text(replace(left, extended=FittedModel(slowed)))
    assert "depends on speed_m_s, beyond its established effect (speed_width); no other known cause" in words


def test_non_finite_numbers_become_null(written: Written) -> None:
    odd = replace(FOUND, gain=float("nan"))
    assert verdict(replace(written.result, established=(odd,)))["established"][0]["gain"] is None


def test_unobservable_causes_are_grouped_by_reason(written: Written) -> None:
    unseen = {"latency": "no times", "speed_width": "no times", "wet_mixing": "no paint below"}
    known = written.result.known
    assert isinstance(known, StrokeProblem)
    decided = replace(written.result.decided, known=replace(known, unobservable=unseen))
    words = text(replace(written.result, decided=decided))
    assert words.count("no times") == 1 and "latency, speed_width" in words and "wet_mixing" in words


@pytest.mark.parametrize("shifted", [0.87, None])
def test_verdict_mentions_the_outside_table(written: Written, shifted: float | None) -> None:
    content = verdict(written.result, shifted=shifted)
    assert content["gap_closed"]["shifted"] == shifted
    assert ("outside table" in content["text"]) == (shifted is not None)


def test_notes_end_the_text(written: Written) -> None:
    assert verdict(written.result, notes=["Row 3 is left out."])["text"].endswith("Row 3 is left out.")
