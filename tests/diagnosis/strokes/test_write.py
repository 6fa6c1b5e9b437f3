"""Files of a diagnosis, and errors before anything is written."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.strokes.measured import load_measured
from pentimento.diagnosis.strokes.model import UnevenEnds, read_model
from pentimento.diagnosis.strokes.out_of_distribution import gap_closed_outside, paints_of, with_joint_paints
from pentimento.diagnosis.strokes.predict import residual
from pentimento.diagnosis.strokes.problem import stroke_problem
from pentimento.diagnosis.strokes.write import write_diagnosis
from pentimento.diagnosis.verdict import NEXT_ACTIONS
from pentimento.dynamics.strokes.mechanisms import VOCABULARY
from tests.diagnosis.strokes.conftest import Written


def test_writes_every_file(written: Written) -> None:
    verdict = json.loads((written.folder / "verdict.json").read_text())
    assert verdict["schema"] == 2
    assert pq.read_table(written.folder / NEXT_ACTIONS).num_rows == 16
    assert (written.folder / "report.html").stat().st_size > 100_000
    assert {file.stem for file in (written.folder / "figures").glob("*.png")} >= {
        "leave_one_out", "strokes", "residual_stroke", "residual_canvas", "modes", "dependence", "aliasing",
        "next_actions",
    }  # fmt: skip
    assert not [file for file in written.folder.rglob(".*")]


def test_copied_row_is_left_out_and_reported(written: Written) -> None:
    verdict = json.loads((written.folder / "verdict.json").read_text())
    assert verdict["rows"] == 56
    assert "Row 56 (counted from 0) is an exact copy" in verdict["text"]
    assert any("copy" in line for line in written.lines)


def test_few_actions_are_mentioned(written: Written) -> None:
    verdict = json.loads((written.folder / "verdict.json").read_text())
    assert "different actions; with fewer than about 60, only large effects are found" in verdict["text"]


def test_extended_model_file_round_trips(written: Written) -> None:
    model, paints = read_model(written.folder / "extended_model.json")
    causes = {m.cause for m in model.mechanisms} - {UnevenEnds.cause}  # which are the base's
    assert causes == {f.cause for f in written.result.established}
    model, strokes = with_joint_paints(model, paints, written.measured)
    np.testing.assert_allclose(
        residual(model, strokes), residual(written.result.extended.model, written.measured), atol=1e-6
    )


def test_unknown_paint_gets_no_offset(written: Written) -> None:
    model, paints = written.result.extended.model, paints_of(written.measured)
    other, strokes = with_joint_paints(model, paints + 0.5, written.measured)
    assert len(other.color_offset) == 2 * len(paints)
    np.testing.assert_array_equal(other.color_offset[strokes.paint], 0.0)


def test_known_colour_gets_the_mean_offset_of_its_mixes(written: Written) -> None:
    model, paints = written.result.extended.model, paints_of(written.measured)
    darker = replace(model, color_offset=np.concatenate([model.color_offset, model.color_offset - 0.02]))
    other, strokes = with_joint_paints(darker, np.concatenate([paints, paints]), written.measured)
    np.testing.assert_allclose(
        other.color_offset[strokes.paint], (model.color_offset - 0.01)[written.measured.paint], atol=1e-12
    )


def test_outside_table_of_the_same_world_shows_the_same_gain(written: Written) -> None:
    outside = load_measured(example_table(40, seed=5))
    closed = gap_closed_outside(outside, stroke_problem(written.measured, VOCABULARY, 0), written.result)
    known = written.result.gap_closed
    assert closed is not None and known is not None
    assert closed == pytest.approx(known[0], abs=0.25)


def test_writes_nothing_for_too_few_rows(tmp_path: Path) -> None:
    with pytest.raises(ContractError, match="15"):
        write_diagnosis(example_table(8), tmp_path / "out", 0, log=lambda line: None)
    assert not (tmp_path / "out").exists()


def test_rejects_model_file_of_another_kind(tmp_path: Path) -> None:
    (tmp_path / "model.json").write_text('{"schema": 1, "kind": "pushes"}')
    with pytest.raises(ContractError, match="pushes"):
        read_model(tmp_path / "model.json")
    with pytest.raises(ContractError, match="pentimento diagnose"):
        read_model(tmp_path / "nowhere.json")


def test_next_actions_table_is_executable(written: Written) -> None:
    table = pq.read_table(written.folder / "next_actions.parquet")
    assert isinstance(table, pa.Table)
    for row in table.to_pylist():
        path = np.array(row["path"])
        assert path.shape[1] == 5 and (np.diff(path[:, 0]) > 0).all()
        x_min, y_min, x_max, y_max = row["window_m"]
        assert ((path[:, 1] > x_min) & (path[:, 1] < x_max) & (path[:, 2] > y_min) & (path[:, 2] < y_max)).all()
        assert row["wait_s"] >= 0 and row["separates"]
    assert table["order"].to_pylist() == list(range(16))
