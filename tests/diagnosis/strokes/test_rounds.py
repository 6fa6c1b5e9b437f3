"""Rounds of diagnosis: they go on while rivals are left, and no longer than asked."""

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
    """Rounds whose diagnoses are given by the rivals that each finds; what was diagnosed, made and said."""
    diagnosed: list[tuple[int, str | None]] = []
    made: list[tuple[int, int]] = []
    said: list[str] = []
    folder.mkdir(exist_ok=True)

    def diagnose(table: pa.Table, note: str | None) -> Any:
        diagnosed.append((table.num_rows, note))
        pq.write_table(pa.table({"order": list(range(proposed))}), folder / "next_actions.parquet")
        return SimpleNamespace(established=[SimpleNamespace(cause="ink_depletion", rivals=rivals[len(diagnosed) - 1])])

    def make(actions: pa.Table, table: pa.Table, number: int) -> pa.Table:
        made.append((actions.num_rows, number))
        return with_humidity(example_table(actions.num_rows, seed=number), None)

    start = with_humidity(example_table(8), 0.4)
    table = diagnose_in_rounds(start, folder, rounds, diagnose, make, said.append)
    return table, diagnosed, made, said


def test_it_ends_when_no_rival_is_left(tmp_path: Path) -> None:
    table, diagnosed, made, said = played(tmp_path, 5, [("canvas_tilt",), ("canvas_tilt", "tool_wear"), ()])
    assert [rows for rows, _ in diagnosed] == [8, 10, 12] and made == [(2, 1), (2, 2)]
    assert table.num_rows == 12 == read_table(tmp_path / "strokes", CONTRACT).table.num_rows
    assert "canvas_tilt." in said[0] and "does not record humidity:" in said[1]
    assert "ink_depletion from canvas_tilt, ink_depletion from tool_wear." in said[2] and "No established" in said[-1]
    assert diagnosed[0][1] is None and "4 of the strokes" in str(diagnosed[2][1])


def test_it_ends_after_as_many_rounds_as_were_asked_for(tmp_path: Path) -> None:
    _, diagnosed, made, _ = played(tmp_path, 2, [("canvas_tilt",)] * 9)
    assert len(diagnosed) == 3 and len(made) == 2


@pytest.mark.parametrize(
    ("rivals", "proposed"),
    [((), 2), (("canvas_tilt",), 0), (("ink_depletion",), 2)],
    ids=["no rivals", "no proposals", "a rival that is established too"],
)
def test_nothing_is_made_without_need(rivals: tuple[str, ...], proposed: int, tmp_path: Path) -> None:
    table, diagnosed, made, said = played(tmp_path, 3, [rivals], proposed)
    assert (len(diagnosed), made, len(said)) == (1, [], 1) and table.num_rows == 8
    assert not (tmp_path / "strokes").exists()
