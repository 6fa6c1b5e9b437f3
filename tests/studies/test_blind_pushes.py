"""Simulated worlds of pushes: seeds, counterfactual rows and effect energies."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pentimento.collection.pushes import PushCollectionConfig
from pentimento.contracts.pushes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.diagnosis.pushes.measured import PIXELS_PER_M
from pentimento.dynamics.pushes.measured import load_pushes
from studies.blind.one_world import with_shuffled
from studies.blind.pushes.collect import as_table, decoys, rows_with_and_without
from studies.blind.pushes.strength import Trial, absorbed, find_strength, measure, prepare_trial, rest_of
from studies.blind.pushes.worlds import CAUSES, Sketch, sketch_world
from studies.blind.series import COLUMNS
from studies.blind.truth import Strength, StrengthError, Truth, write_world


def without_repeats(sketch: Sketch, pushes: int) -> PushCollectionConfig:
    return replace(sketch.config, pushes=pushes, repeated=0, times=1)


def some_rows(sketch: Sketch, pushes: int) -> list[dict[str, Any]]:
    return rows_with_and_without(sketch, sketch.world, 1, without_repeats(sketch, pushes))[0]


def test_equal_seeds_give_equal_worlds() -> None:
    one, again, other = (sketch_world("one", seed) for seed in (5, 5, 6))
    assert (one.world, one.causes, one.q) == (again.world, again.causes, again.q)
    assert one.world != other.world
    assert not any(vars(one.world.effects).values())


def test_every_cause_is_drawn() -> None:
    drawn = {cause for seed in range(120) for cause in sketch_world("one", seed).causes}
    assert drawn == set(CAUSES)
    assert all(len(set(sketch_world("two", seed).causes)) == 2 for seed in range(20))


def test_recording_meets_the_contract_and_has_decoys(tmp_path: Path) -> None:
    sketch = sketch_world("none", 1)
    recorded = some_rows(sketch, 3)
    table = as_table(recorded, decoys(3, 1))
    write_world(tmp_path, table, truth())
    read = read_table(tmp_path / "table.parquet", CONTRACT)
    assert read.table.num_rows == 3 and not read.quarantined
    assert {"battery_v", "temperature_c", "humidity", "retract_speed_m_s"} <= set(read.table.column_names)


def test_counterfactual_pushes_have_the_same_surface_and_random_numbers() -> None:
    sketch = sketch_world("none", 2)
    for strengths, equal in (({}, True), ({"adhesion_lift": 2.0}, False)):
        with_effects, quiet = (
            load_pushes(as_table(rows, {}), PIXELS_PER_M)[0]
            for rows in rows_with_and_without(sketch, sketch.with_strengths(strengths), 1, without_repeats(sketch, 4))
        )
        assert np.array_equal(with_effects.before, quiet.before)
        differ = np.abs(with_effects.after - quiet.after).max((1, 2))
        assert (differ == 0).all() if equal else (differ > 5e-4).all()


def test_effect_that_the_base_absorbs_has_no_energy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("studies.blind.pushes.strength.PUSHES", 12)
    trial = prepare_trial(sketch_world("none", 2))
    nothing, peaks = (measure(trial, "adhesion_lift", strength) for strength in (0.0, 1.0))
    assert nothing.q == 0.0 < peaks.q
    seen = load_pushes(as_table(some_rows(trial.sketch, 12), {}), PIXELS_PER_M)[0]
    modes = absorbed(seen)
    assert np.abs(rest_of(modes[3] - 0.5 * modes[7], modes)).max() < 1e-6 * np.abs(modes[3]).max()


def test_find_strength_reaches_the_wanted_energy_or_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    def square(trial: Trial, effect: str, strength: float) -> Strength:
        return Strength(strength, 0.5 * strength**2, 0.0)

    monkeypatch.setattr("studies.blind.pushes.strength.measure", square)
    trial: Any = Trial(sketch_world("one", 3), ())  # type: ignore[arg-type]
    found = find_strength(trial, "far_field", 0.2)
    assert found.q == pytest.approx(0.2, rel=0.25)
    with pytest.raises(StrengthError, match="far_field"):
        find_strength(trial, "far_field", 50.0)
    assert measure is not square


def test_shuffling_permutes_the_values_of_the_columns_of_a_cause() -> None:
    sketch = sketch_world("none", 1)
    table = as_table(some_rows(sketch, 8), {})
    shuffled = with_shuffled(table, "adhesion_lift", 4)
    names = list(COLUMNS["adhesion_lift"])
    for name in names:
        one, other = (np.array(t[name].to_pylist()) for t in (table, shuffled))
        assert np.allclose(np.sort(one), np.sort(other)) and not np.allclose(one, other)
    assert shuffled.drop(names).equals(table.drop(names))


def truth() -> Truth:
    return Truth("one", 1, "ball", ("far_field",), None, (0.2,), (), False)
