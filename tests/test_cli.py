"""The command line: what it prints, what it writes, and how it says no."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pentimento.cli import main
from pentimento.contracts.strokes import example_table


def rows_with(table: pa.Table, **values: Any) -> pa.Table:
    """The table with the same values in every row."""
    return pa.Table.from_pylist([row | values for row in table.to_pylist()], schema=table.schema)


def run(table: pa.Table, folder: Path, *more: str) -> int:
    pq.write_table(table, folder / "rows.parquet")
    return main(["diagnose", str(folder / "rows.parquet"), "--out", str(folder / "out"), *more])


def test_diagnose_finds_the_depletion_of_the_example_strokes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """They grow paler with the length drawn since the last dip, there as in an outside table."""
    pq.write_table(example_table(40, seed=9), tmp_path / "outside.parquet")
    assert run(example_table(72), tmp_path, "--kind", "strokes", "--test", str(tmp_path / "outside.parquet")) == 0
    verdict = json.loads((tmp_path / "out/verdict.json").read_text())
    assert verdict["schema"] == 1 and verdict["rows"] == 72
    assert [entry["cause"] for entry in verdict["established"]] == ["ink_depletion"]
    assert verdict["mse"]["extended"] < verdict["mse"]["base"]
    assert verdict["established"][0]["parameters"]["density_loss"]["value"] > 0
    assert verdict["gap_closed"]["shifted"] > 0.3
    printed = capsys.readouterr()
    assert verdict["sentence"] in printed.out and "report.html" in printed.out
    assert printed.err == ""  # no terminal: nothing but the verdict


def test_what_was_not_recorded_is_said_and_the_rest_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Times, ink and wear unknown, nothing repeated, one row torn: no floor, and what cannot be decided."""
    unknown = dict.fromkeys(("ink_since_reload_m", "tool_age_m", "t_start_s", "t_before_s", "t_after_s"), np.nan)
    table = rows_with(example_table(36), since_reload=None, reload_id=None, **unknown)
    rows = table.to_pylist()
    for number, row in enumerate(rows):
        row["action_id"] = number
        row["path"] = [[float("nan"), *point[1:]] for point in row["path"]]
    rows[7]["after"]["bytes"] = rows[7]["after"]["bytes"][:100]
    assert run(pa.Table.from_pylist(rows, schema=table.schema), tmp_path) == 0
    verdict = json.loads((tmp_path / "out/verdict.json").read_text())
    assert verdict["rows"] == 35 and verdict["mse"]["floor"] is None and verdict["gap_closed"]["test"] is None
    for said in ("floor is unknown", "speeds are unknown", "ink_depletion", "row 7"):
        assert said in verdict["sentence"]
    assert all(np.isnan(pq.read_table(tmp_path / "out/next_actions.parquet")["path"][0].as_py())[:, 0])
    capsys.readouterr()


@pytest.mark.parametrize(
    ("rows", "says"), [(0, "no rows"), (1, "12"), (10, "at least 12")], ids=["none", "one", "too few"]
)
def test_diagnose_says_what_it_cannot_do_with_few_rows(
    rows: int, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(example_table(max(rows, 1)).slice(0, rows), tmp_path) == 1
    assert says in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"after": {"bytes": b"torn", "path": None}}, "not a readable PNG"),
        ({"window_m": [1.0, 1.0, 1.08, 1.056]}, "lies outside its window"),
        ({"window_m": [0.1, 0.1, 0.05, 0.2]}, "window_m"),
        ({"path": [[0.0, 0.1, float("nan"), 0.0, 0.0]] * 3}, "NaN"),
    ],
    ids=["torn images", "windows elsewhere", "windows inside out", "paths without places"],
)
def test_a_recording_that_is_wrong_is_refused(
    values: dict[str, Any], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(rows_with(example_table(20), **values), tmp_path) == 1
    assert says in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_copies_of_one_row_are_one_action(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(pa.concat_tables([example_table(1)] * 40), tmp_path) == 1
    assert "1 different actions" in capsys.readouterr().err


def test_a_table_that_is_not_there_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["diagnose", str(tmp_path / "nowhere.parquet"), "--out", str(tmp_path / "out")]) == 1
    assert "nowhere.parquet" in capsys.readouterr().err


def test_a_kind_that_there_is_not_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SystemExit):
        main(["diagnose", str(tmp_path), "--out", str(tmp_path / "out"), "--kind", "sculptures"])
