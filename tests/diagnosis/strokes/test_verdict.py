"""The verdict in schema 1 and as a sentence."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from pentimento.diagnosis.residual_structure import Unexplained
from pentimento.diagnosis.temporal_drift import TemporalDrift
from pentimento.diagnosis.verdict import Finding, sentence, verdict
from pentimento.dynamics.strokes.mechanisms.bristle_lag import BristleLag
from pentimento.dynamics.strokes.mechanisms.speed_width import SpeedWidth
from tests.diagnosis.strokes.conftest import Written

KEYS = [
    "schema", "kind", "rows", "actions", "mse", "established", "suspected", "gap_closed", "unexplained",
    "floor_reached", "next_actions", "sentence",
]  # fmt: skip
FOUND = Finding(
    "bristle_lag", 0.004, 0.002, 0.41, (0.2, 0.6), {"distance_m": (0.0042, 0.0003)}, ("path_scale",)
)  # fmt: skip


def test_verdict_has_the_keys_of_schema_1(written: Written) -> None:
    content = verdict(written.diagnosis, 56, 42)
    assert list(content) == KEYS
    assert list(content["mse"]) == ["base", "extended", "floor", "floor_ci"]
    assert list(content["gap_closed"]) == ["test", "ci", "shifted"]
    json.dumps(content, allow_nan=False)


def test_finding_has_quantities_and_rivals(written: Written) -> None:
    found = replace(written.diagnosis, established=(FOUND,))
    entry = verdict(found, 56, 42)["established"][0]
    assert entry["parameters"] == {"distance_m": {"value": 0.0042, "se": 0.0003}}
    assert entry["rivals"] == ["path_scale"] and entry["gain_ci"] == [0.2, 0.6]
    text = sentence(found)
    assert "bristle_lag" in text and "41%" in text and "To separate bristle_lag from path_scale" in text


def test_floor_and_gap_are_unknown_without_repeats(written: Written) -> None:
    content = verdict(replace(written.diagnosis, floor=None), 56, 42)
    assert (
        content["mse"]["floor"] is None and content["floor_reached"] is None and content["gap_closed"]["test"] is None
    )
    assert "floor is unknown" in content["sentence"]


def test_verdict_reports_temporal_drift(written: Written) -> None:
    drifts = TemporalDrift("width", 0.0005, 3e-5, 2e-5, np.zeros(56))
    found = replace(written.diagnosis, drifts=drifts, established=(), unexplained=())
    assert "width drifts" in sentence(found)
    assert verdict(found, 56, 42)["drifts"]["mse_of_repeats"] == 2e-5
    known = Unexplained("width", "temperature_c", 0.001, 0.2)
    assert "drifts" not in sentence(replace(found, unexplained=(known,)))


def test_structure_of_an_established_covariate_is_attributed_to_it(written: Written) -> None:
    """A law of another form leaves some of its own effect; "no cause explains it" would suggest a new one."""
    left = replace(written.diagnosis, suspected=(), unexplained=(Unexplained("width", "speed_m_s", 0.001, 0.2),))
    plain = left.extended.without(*(m.cause for m in left.extended.mechanisms))
    slowed = plain.plus(*(kind(torch.zeros(len(kind.quantities)), {}) for kind in (SpeedWidth, BristleLag)))
    assert "depends on speed_m_s; no known cause" in sentence(replace(left, extended=plain))
    text = sentence(replace(left, extended=slowed))
    assert "depends on speed_m_s, beyond its established effect (speed_width); no other known cause" in text


def test_non_finite_numbers_become_null(written: Written) -> None:
    odd = replace(FOUND, gain=float("nan"))
    assert verdict(replace(written.diagnosis, established=(odd,)), 56, 42)["established"][0]["gain"] is None


def test_unobservable_causes_are_grouped_by_reason(written: Written) -> None:
    unseen = {"latency": "no times", "speed_width": "no times", "wet_mixing": "no paint below"}
    text = sentence(replace(written.diagnosis, search=replace(written.diagnosis.search, not_observable=unseen)))
    assert text.count("no times") == 1 and "latency, speed_width" in text and "wet_mixing" in text


@pytest.mark.parametrize("shifted", [0.87, None])
def test_verdict_mentions_the_outside_table(written: Written, shifted: float | None) -> None:
    content = verdict(written.diagnosis, 56, 42, shifted=shifted)
    assert content["gap_closed"]["shifted"] == shifted
    assert ("outside table" in content["sentence"]) == (shifted is not None)


def test_notes_end_the_paragraph(written: Written) -> None:
    assert verdict(written.diagnosis, 56, 42, notes=["Row 3 is left out."])["sentence"].endswith("Row 3 is left out.")


def test_misattributed_and_unconfirmed_causes_are_separate(written: Written) -> None:
    wear = replace(FOUND, cause="tool_wear", misattributed=True)
    text = sentence(replace(written.diagnosis, established=(), suspected=(FOUND, wear)))
    assert "Suspected, but not confirmed: bristle_lag." in text
    assert "Not better than an effect without a name, and so not established: tool_wear." in text
    assert "Suspected" not in sentence(replace(written.diagnosis, established=(), suspected=(wear,)))
