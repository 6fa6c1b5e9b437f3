"""Blind clay worlds: drawn by seed alone, sealed, and what is counted of their verdicts."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pentimento.collection.push_design import PushCollectionConfig
from pentimento.contracts.pushes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.diagnosis.pushes.measured import PIXELS_PER_M
from pentimento.dynamics.pushes.measured import load_pushes
from studies.blind.make import write_world
from studies.blind.one_world import SealError, opened
from studies.blind_pushes.collect import as_table, decoys, rows_with_and_without
from studies.blind_pushes.make import Truth
from studies.blind_pushes.one_world import with_shuffled
from studies.blind_pushes.page import page
from studies.blind_pushes.score_card import covariate_found, rows
from studies.blind_pushes.series import COLUMNS
from studies.blind_pushes.strength import Trial, absorbed, find_strength, measure, prepare_trial, rest_of
from studies.blind_pushes.worlds import CAUSES, Sketch, sketch_world


def without_repeats(sketch: Sketch, pushes: int) -> PushCollectionConfig:
    return replace(sketch.config, pushes=pushes, repeated=0, times=1)


def some_rows(sketch: Sketch, pushes: int) -> list[dict[str, Any]]:
    return rows_with_and_without(sketch, sketch.world, 1, without_repeats(sketch, pushes))[0]


def test_a_seed_draws_one_world() -> None:
    one, again, other = (sketch_world("one", seed) for seed in (5, 5, 6))
    assert (one.world, one.causes, one.q) == (again.world, again.causes, again.q)
    assert one.world != other.world
    assert not any(vars(one.world.effects).values())


def test_every_cause_comes_up() -> None:
    drawn = {cause for seed in range(120) for cause in sketch_world("one", seed).causes}
    assert drawn == set(CAUSES)
    assert all(len(set(sketch_world("two", seed).causes)) == 2 for seed in range(20))


def test_a_recording_keeps_the_contract_and_has_decoys(tmp_path: Path) -> None:
    sketch = sketch_world("none", 1)
    recorded = some_rows(sketch, 3)
    table = as_table(recorded, decoys(3, 1))
    write_world(tmp_path, table, truth())
    read = read_table(tmp_path / "table.parquet", CONTRACT)
    assert read.table.num_rows == 3 and not read.quarantined
    assert {"battery_v", "temperature_c", "humidity", "retract_speed_m_s"} <= set(read.table.column_names)


def test_a_truth_that_was_changed_after_it_was_sealed_is_found_out(tmp_path: Path) -> None:
    sketch = sketch_world("none", 1)
    table = as_table(some_rows(sketch, 2), {})
    write_world(tmp_path, table, truth())
    seal = (tmp_path / "truth.sha256").read_text().strip()
    assert opened(tmp_path / "truth.json", seal)["causes"] == ["far_field"]
    assert seal == hashlib.sha256((tmp_path / "truth.json").read_bytes()).hexdigest()
    (tmp_path / "truth.json").write_text("{}")
    with pytest.raises(SealError):
        opened(tmp_path / "truth.json", seal)


def test_each_push_is_made_with_and_without_the_effect_on_one_surface_by_one_chance() -> None:
    sketch = sketch_world("none", 2)
    for strengths, alike in (({}, True), ({"adhesion_lift": 2.0}, False)):
        loud, quiet = (
            load_pushes(as_table(rows, {}), PIXELS_PER_M)[0]
            for rows in rows_with_and_without(sketch, sketch.with_strengths(strengths), 1, without_repeats(sketch, 4))
        )
        assert np.array_equal(loud.before, quiet.before)
        differ = np.abs(loud.after - quiet.after).max((1, 2))
        assert (differ == 0).all() if alike else (differ > 5e-4).all()


def test_an_effect_that_the_base_can_do_has_no_energy() -> None:
    trial = prepare_trial(sketch_world("none", 2))
    nothing, peaks = (measure(trial, "adhesion_lift", strength) for strength in (0.0, 1.0))
    assert nothing.q == 0.0 < peaks.q
    seen = load_pushes(as_table(some_rows(trial.sketch, 12), {}), PIXELS_PER_M)[0]
    can_do = absorbed(seen)
    assert np.abs(rest_of(can_do[3] - 0.5 * can_do[7], can_do)).max() < 1e-6 * np.abs(can_do[3]).max()


def test_the_strength_is_sought_where_q_is_wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    from studies.blind.strength import Strength, StrengthError

    def square(trial: Trial, effect: str, strength: float) -> Strength:
        return Strength(strength, 0.5 * strength**2, 0.0)

    monkeypatch.setattr("studies.blind_pushes.strength.measure", square)
    trial: Any = Trial(sketch_world("one", 3), ())  # type: ignore[arg-type]
    found = find_strength(trial, "far_field", 0.2)
    assert found.q == pytest.approx(0.2, rel=0.25)
    with pytest.raises(StrengthError, match="far_field"):
        find_strength(trial, "far_field", 50.0)
    assert measure is not square


def test_shuffling_leaves_the_values_and_breaks_their_order() -> None:
    sketch = sketch_world("none", 1)
    table = as_table(some_rows(sketch, 8), {})
    shuffled = with_shuffled(table, "adhesion_lift", 4)
    names = list(COLUMNS["adhesion_lift"])
    for name in names:
        one, other = (np.array(t[name].to_pylist()) for t in (table, shuffled))
        assert np.allclose(np.sort(one), np.sort(other)) and not np.allclose(one, other)
    assert shuffled.drop(names).equals(table.drop(names))


def line(series: str, causes: list[str], named: list[str], left: list[dict[str, Any]] | None = None) -> dict[str, Any]:
    outside = {"effect": "speed_footprint", "mode": "width", "column": "speed_m_s"} if series == "outside" else None
    entries = [{"cause": name, "gain": 0.5, "rivals": []} for name in named]
    closed = {"test": 0.95, "ci": [0.9, 1.0], "shifted": None}
    return {
        "series": series, "index": 0, "seed": 1, "code": "c", "seconds": 9.0, "make_s": 1.0,
        "truth": {"causes": causes, "outside": outside, "wanted_q": [0.2], "tool": "ball", "strengths": []},
        "verdict": {
            "established": entries, "suspected": [], "unexplained": left or [], "gap_closed": closed,
            "mse": {"base": 0.03, "floor": 0.01},
        },
    }  # fmt: skip


def test_what_is_counted() -> None:
    found = {"mode": "width", "covariate": "speed_m_s", "p": 0.001, "generic_gain": 0.1}
    lines = [
        line("one cause", ["far_field"], ["far_field"]),
        line("one cause", ["far_field"], ["volume_loss"]),
        line("one cause", ["tool_backlash"], ["tool_backlash", "far_field"]),
        line("none", [], []),
        line("none", [], ["far_field"]),
        line("outside", [], [], [found]),
    ]
    counted = {row.what: (row.hits, row.of) for row in rows(lines)}
    assert counted["one material cause, q .1 to .4: exact set"] == (1, 2)
    assert counted["one geometric cause, q .1 to .4: exact set"] == (0, 1)
    assert counted["none: any name at all"] == (1, 2)
    assert counted["over all: false names among names"] == (3, 5)
    assert counted["outside the vocabulary: right covariate and mode"] == (1, 1)
    constant = {row.what: row.constant for row in rows(lines)}
    assert constant["one material cause, q .1 to .4: exact set"] == 1.0  # both hide the same
    assert constant["over all: false names among names"] == pytest.approx(4 / 6)
    assert covariate_found(lines[-1])
    written = page(lines, "abc")
    assert "far_field" in written and "share of the table" in written


def test_a_deleted_candidate_leaves_something_unexplained_or_not() -> None:
    found = {"mode": "depth", "covariate": "order", "p": 0.001, "generic_gain": 0.1}
    lines = [line("deleted", ["stiffness_drift"], ["stiffness_drift"]) for _ in range(3)]
    for each, left, names in zip(lines, ([found], [], [found]), ([], [], ["far_field"]), strict=True):
        each["second"] = line("deleted", [], names, left)["verdict"]
    counted = {row.what: (row.hits, row.of) for row in rows(lines)}
    assert counted["true candidate deleted: no neighbour is named"] == (2, 3)
    assert counted["true candidate deleted: something is left unexplained"] == (2, 3)


def truth() -> Truth:
    return Truth("one", 1, "ball", ("far_field",), None, (0.2,), (), False)
