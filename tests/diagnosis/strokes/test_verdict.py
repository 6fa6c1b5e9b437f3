"""The verdict says what was found, in schema 1 and in words."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from pentimento.diagnosis.residual_structure import TemporalDrift, Unexplained
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


def test_the_keys_are_those_of_schema_1(written: Written) -> None:
    made = verdict(written.diagnosis, 56, 42)
    assert list(made) == KEYS
    assert list(made["mse"]) == ["base", "extended", "floor", "floor_ci"]
    assert list(made["gap_closed"]) == ["test", "ci", "shifted"]
    json.dumps(made, allow_nan=False)


def test_a_finding_carries_its_quantities_and_rivals(written: Written) -> None:
    found = replace(written.diagnosis, established=(FOUND,))
    entry = verdict(found, 56, 42)["established"][0]
    assert entry["parameters"] == {"distance_m": {"value": 0.0042, "se": 0.0003}}
    assert entry["rivals"] == ["path_scale"] and entry["gain_ci"] == [0.2, 0.6]
    said = sentence(found)
    assert "bristle_lag" in said and "41%" in said and "To tell bristle_lag from path_scale" in said


def test_without_repeats_the_floor_and_what_needs_it_are_unknown(written: Written) -> None:
    made = verdict(replace(written.diagnosis, floor=None), 56, 42)
    assert made["mse"]["floor"] is None and made["floor_reached"] is None and made["gap_closed"]["test"] is None
    assert "floor is unknown" in made["sentence"]


def test_a_state_that_nobody_recorded_is_said_where_nothing_else_explains_it(written: Written) -> None:
    drifts = TemporalDrift("width", 0.0005, 3e-5, 2e-5, np.zeros(56))
    found = replace(written.diagnosis, drifts=drifts, established=(), unexplained=())
    assert "width wanders" in sentence(found)
    assert verdict(found, 56, 42)["drifts"]["mse_of_repeats"] == 2e-5
    known = Unexplained("width", "temperature_c", 0.001, 0.2)
    assert "drifts" not in sentence(replace(found, unexplained=(known,)))


def test_structure_in_a_column_that_an_established_cause_speaks_of_is_what_it_leaves(written: Written) -> None:
    """A law of another form leaves some of its own effect: "no cause explains it" would be read as a new one."""
    left = replace(written.diagnosis, suspected=(), unexplained=(Unexplained("width", "speed_m_s", 0.001, 0.2),))
    plain = left.extended.without(*(m.cause for m in left.extended.mechanisms))
    slowed = plain.plus(*(kind(torch.zeros(len(kind.quantities)), {}) for kind in (SpeedWidth, BristleLag)))
    assert "depends on speed_m_s; no known cause" in sentence(replace(left, extended=plain))
    said = sentence(replace(left, extended=slowed))
    assert "depends on speed_m_s, beyond what is established of it (speed_width); no other known cause" in said


def test_numbers_that_json_cannot_hold_are_unknown(written: Written) -> None:
    odd = replace(FOUND, gain=float("nan"))
    assert verdict(replace(written.diagnosis, established=(odd,)), 56, 42)["established"][0]["gain"] is None


def test_what_cannot_be_decided_is_said_once_for_each_reason(written: Written) -> None:
    unseen = {"latency": "no times", "speed_width": "no times", "wet_mixing": "no paint below"}
    said = sentence(replace(written.diagnosis, search=replace(written.diagnosis.search, not_observable=unseen)))
    assert said.count("no times") == 1 and "latency, speed_width" in said and "wet_mixing" in said


@pytest.mark.parametrize("shifted", [0.87, None])
def test_an_outside_table_is_spoken_of_when_there_is_one(written: Written, shifted: float | None) -> None:
    made = verdict(written.diagnosis, 56, 42, shifted)
    assert made["gap_closed"]["shifted"] == shifted
    assert ("outside table" in made["sentence"]) == (shifted is not None)


def test_notes_end_the_paragraph(written: Written) -> None:
    assert verdict(written.diagnosis, 56, 42, notes=["Row 3 is left out."])["sentence"].endswith("Row 3 is left out.")


def test_what_has_no_name_and_does_as_well_is_told_from_what_was_not_confirmed(written: Written) -> None:
    wear = replace(FOUND, cause="tool_wear", misattributed=True)
    said = sentence(replace(written.diagnosis, established=(), suspected=(FOUND, wear)))
    assert "Suspected, not confirmed on strokes that had no part in the search: bristle_lag." in said
    assert "No better than what has no name, and so not named: tool_wear." in said
    assert "Suspected" not in sentence(replace(written.diagnosis, established=(), suspected=(wear,)))
