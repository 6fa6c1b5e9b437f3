"""The command line: what it prints, what it writes, and how it says no."""

import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from pentimento.cli import main
from pentimento.contracts.strokes import example_table


def test_diagnose_finds_the_depletion_of_the_example_strokes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """They grow paler with the length drawn since the last dip, and nothing else is wrong with them."""
    pq.write_table(example_table(96), tmp_path / "rows.parquet")
    assert main(["diagnose", str(tmp_path / "rows.parquet"), "--out", str(tmp_path / "out")]) == 0
    verdict = json.loads((tmp_path / "out/verdict.json").read_text())
    assert verdict["schema"] == 1 and verdict["rows"] == 96
    assert [entry["cause"] for entry in verdict["established"]] == ["ink_depletion"]
    assert verdict["mse"]["extended"] < verdict["mse"]["base"]
    assert verdict["established"][0]["parameters"]["density_loss"]["value"] > 0
    assert verdict["sentence"] in capsys.readouterr().out


@pytest.mark.parametrize(
    ("rows", "says"), [(0, "no rows"), (1, "12"), (10, "at least 12")], ids=["none", "one", "too few"]
)
def test_diagnose_says_what_it_cannot_do_with_few_rows(
    rows: int, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pq.write_table(example_table(max(rows, 1)).slice(0, rows), tmp_path / "rows.parquet")
    assert main(["diagnose", str(tmp_path / "rows.parquet"), "--out", str(tmp_path / "out")]) == 1
    assert says in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_table_that_is_not_there_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["diagnose", str(tmp_path / "nowhere.parquet"), "--out", str(tmp_path / "out")]) == 1
    assert "nowhere.parquet" in capsys.readouterr().err
