"""Diagnosis in rounds continues while rivals remain, up to the requested number."""

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pentimento.contracts.strokes import CONTRACT, example_table
from pentimento.contracts.tables import read_table
from pentimento.diagnosis.strokes.write import diagnose_in_rounds


def with_humidity(table: pa.Table, value: float | None) -> pa.Table:
    return table.append_column("humidity", pa.array([value] * table.num_rows, pa.float32()))


def played(folder: Path, rounds: int, rivals: Sequence[tuple[str, ...]], proposed: int = 2) -> tuple[Any, ...]:
    """Rounds whose diagnoses have the given rivals; returns what was diagnosed, collected and logged."""
    diagnosed: list[tuple[int, str | None]] = []
    collected: list[tuple[int, int]] = []
    lines: list[str] = []
    folder.mkdir(exist_ok=True)

    def diagnose(table: pa.Table, note: str | None) -> Any:
        diagnosed.append((table.num_rows, note))
        pq.write_table(pa.table({"order": list(range(proposed))}), folder / "next_actions.parquet")
        finding = SimpleNamespace(cause="ink_depletion", rivals=rivals[len(diagnosed) - 1])
        return SimpleNamespace(established=[finding], suspected=[])

    def make(actions: pa.Table, table: pa.Table, number: int) -> pa.Table:
        collected.append((actions.num_rows, number))
        return with_humidity(example_table(actions.num_rows, seed=number), None)

    start = with_humidity(example_table(8), 0.4)
    diagnose_in_rounds(start, folder, rounds, diagnosed=diagnose, made=make, log=lines.append)
    table = read_table(folder / "strokes", CONTRACT).table if (folder / "strokes").exists() else start
    return table, diagnosed, collected, lines


def test_rounds_end_without_rivals(tmp_path: Path) -> None:
    table, diagnosed, collected, lines = played(tmp_path, 5, [("canvas_tilt",), ("canvas_tilt", "tool_wear"), ()])
    assert [rows for rows, _ in diagnosed] == [8, 10, 12] and collected == [(2, 1), (2, 2)]
    assert table.num_rows == 12
    assert "canvas_tilt." in lines[0] and "does not record humidity:" in lines[1]
    assert "ink_depletion from canvas_tilt, ink_depletion from tool_wear." in lines[2] and "No named" in lines[-1]
    assert diagnosed[0][1] is None and "4 of the strokes" in str(diagnosed[2][1])


def test_rounds_end_at_the_requested_number(tmp_path: Path) -> None:
    _, diagnosed, collected, _ = played(tmp_path, 2, [("canvas_tilt",)] * 9)
    assert len(diagnosed) == 3 and len(collected) == 2


@pytest.mark.parametrize(
    ("rivals", "proposed"),
    [((), 2), (("canvas_tilt",), 0), (("ink_depletion",), 2)],
    ids=["no rivals", "no proposals", "a rival that is established too"],
)
def test_no_strokes_are_collected_without_need(rivals: tuple[str, ...], proposed: int, tmp_path: Path) -> None:
    table, diagnosed, collected, lines = played(tmp_path, 3, [rivals], proposed)
    assert (len(diagnosed), collected, len(lines)) == (1, [], 1) and table.num_rows == 8
    assert not (tmp_path / "strokes").exists()
