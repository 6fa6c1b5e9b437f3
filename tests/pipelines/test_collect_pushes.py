"""The stage collect_pushes: pushes collected in the studio, or imported."""

import argparse
import json
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from ruamel.yaml import YAML

import pipelines.collect_pushes as stage
from pentimento.contracts.errors import ContractError
from pentimento.contracts.pushes import CONTRACT, example_table
from pentimento.contracts.tables import read_table, write_table
from pentimento.planning.pushes.place_fit import fit_places

COLLECTION = {
    "pushes": 12,
    "repeated": 2,
    "times": 2,
    "pushes_per_smoothing": [3, 4],
    "revisit_share": 0.5,
    "edge_m": "30 mm",
    "scan_pixels": 64,
    "seed": 1,
}


def collect(folder: Path, source: Path | None = None, pellets: int | None = None) -> dict[str, float]:
    section = {
        "source": {} if source is None else {"sand": str(source)},
        "world": {"sand": "sand"},
        "end_effector": {"sand": "ball"},
        "pellets": {} if pellets is None else {"sand": {"feeder": "pellets", "count": pellets}},
        "collection": COLLECTION,
    }
    YAML(typ="safe").dump({"collect_pushes": section}, folder / "params.yaml")
    stage.main(argparse.Namespace(material="sand", out=folder / "pushes"))
    metrics: dict[str, float] = json.loads((folder / "pushes/metrics.json").read_text())
    return metrics


def test_pushes_made_in_the_studio(stage_folder: Path) -> None:
    metrics = collect(stage_folder)
    table = read_table(stage_folder / "pushes", CONTRACT).table
    assert metrics["rows"] == table.num_rows == 12
    assert set(table.column("material").to_pylist()) == {"sand"}
    assert {"temperature_c", "humidity"} <= set(table.column_names)
    assert 0 <= metrics["hole_share"] < 0.1
    assert abs(metrics["volume_change_mean"]) < 0.002
    assert abs(metrics["dent_volume_lost"]) < 0.4
    assert 0.001 < metrics["repeat_floor_mm2"] < 0.1


def test_pellets_follow_the_pushes_and_are_no_pushes(stage_folder: Path) -> None:
    metrics = collect(stage_folder, pellets=6)
    table = read_table(stage_folder / "pushes", CONTRACT).table
    assert table["kind"].to_pylist() == ["push"] * 12 + ["place"] * 6
    assert table["order"].to_pylist() == list(range(18))
    assert abs(metrics["volume_change_mean"]) < 0.002  # of the pushes
    model = fit_places(table)
    assert 0.5 < model.kept < 1.2 and model.unexplained < 0.3


def test_imports_measured_pushes_and_counts_bad_rows(stage_folder: Path) -> None:
    rows = example_table(150).to_pylist()
    rows[7]["action"] = [float("nan")] * 5

    pq.write_table(pa.Table.from_pylist(rows, schema=example_table(1).schema), stage_folder / "measured.parquet")
    metrics = collect(stage_folder, stage_folder / "measured.parquet")
    assert (metrics["rows"], metrics["quarantined"]) == (149, 1)
    assert "repeat_floor_mm2" not in metrics
    assert "measured.parquet" in (stage_folder / "pushes/README.md").read_text()


def test_an_empty_table_is_an_error(stage_folder: Path) -> None:
    write_table(stage_folder / "none", example_table(0), CONTRACT, "none")
    with pytest.raises(ContractError, match="holds no pushes"):
        collect(stage_folder, stage_folder / "none")
