import os
from pathlib import Path
from types import ModuleType

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pentimento.contracts import copaintings, demonstrations, pushes, scenes, strokes, tables
from pentimento.contracts.errors import ContractError
from pentimento.contracts.tables import is_index, read_table, stream_table, write_shards, write_table

CONTRACT = strokes.CONTRACT


def replaced(table: pa.Table, name: str, values: pa.Array) -> pa.Table:
    return table.set_column(table.column_names.index(name), name, values)


def stored(tmp_path: Path, table: pa.Table) -> Path:
    pq.write_table(table, tmp_path / "rows.parquet")
    return tmp_path / "rows.parquet"


@pytest.mark.parametrize(
    "module", [strokes, pushes, demonstrations, scenes, copaintings], ids=lambda m: m.CONTRACT.name
)
def test_round_trip(tmp_path: Path, module: ModuleType) -> None:
    table = module.example_table(5)
    write_table(tmp_path / "t", table, module.CONTRACT, "# Example")
    again = read_table(tmp_path / "t", module.CONTRACT)
    assert again.quarantined == ()
    assert again.table.schema == table.schema
    for name in table.column_names:
        np.testing.assert_equal(again.table.column(name).to_pylist(), table.column(name).to_pylist())


def test_the_card_explains_the_columns(tmp_path: Path) -> None:
    write_table(tmp_path / "t", strokes.example_table(1), CONTRACT, "# Strokes of a marker\n")
    card = (tmp_path / "t" / "README.md").read_text()
    assert card.startswith("# Strokes of a marker\n") and "| `wet_age_s` | float32 | s |" in card
    assert sorted(p.name for p in (tmp_path / "t").iterdir()) == ["README.md", "part-00000.parquet"]


def test_the_same_rows_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_table(tmp_path / name, strokes.example_table(3), CONTRACT, "# x")
    assert (tmp_path / "a/part-00000.parquet").read_bytes() == (tmp_path / "b/part-00000.parquet").read_bytes()


def test_large_tables_are_split_and_read_in_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    table = scenes.example_table(20)
    monkeypatch.setattr(tables, "SHARD_BYTES", table.nbytes // 4)
    write_shards(tmp_path, table, scenes.CONTRACT)
    assert len(list(tmp_path.glob("part-*.parquet"))) in (4, 5)
    assert read_table(tmp_path, scenes.CONTRACT).table.equals(table)


@pytest.mark.parametrize("rows", [1, 3, 7, 100])
def test_a_streamed_table_is_the_one_that_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rows: int) -> None:
    table = scenes.example_table(20)
    monkeypatch.setattr(tables, "SHARD_BYTES", table.nbytes // 4)
    write_shards(tmp_path, table, scenes.CONTRACT)
    parts = [part.table for part in stream_table(tmp_path, scenes.CONTRACT, rows)]
    assert pa.concat_tables(parts).equals(table) and max(part.num_rows for part in parts) <= rows


def test_an_empty_table_is_streamed_as_one_part(tmp_path: Path) -> None:
    write_shards(tmp_path, scenes.example_table(1).slice(0, 0), scenes.CONTRACT)
    assert [part.table.num_rows for part in stream_table(tmp_path, scenes.CONTRACT, 9)] == [0]


def test_covariates_are_kept(tmp_path: Path) -> None:
    table = strokes.example_table(3).append_column("temperature_c", pa.array([20.0, 21.0, None]))
    write_table(tmp_path / "t", table, CONTRACT, "# x")
    again = read_table(tmp_path / "t", CONTRACT).table
    assert again.column("temperature_c").to_pylist() == [20.0, 21.0, None]


def test_shards_may_differ_in_optional_columns(tmp_path: Path) -> None:
    table = strokes.example_table(4)
    pq.write_table(table.slice(0, 2), tmp_path / "part-00000.parquet")
    pq.write_table(table.slice(2, 2).drop_columns(["gain"]), tmp_path / "part-00001.parquet")
    assert read_table(tmp_path, CONTRACT).table.column("gain").to_pylist() == [1.0, 1.0, None, None]


def test_other_widths_and_layouts_are_cast(tmp_path: Path) -> None:
    table = strokes.example_table(3)
    wide = replaced(table, "order", table.column("order").cast(pa.int64()))
    wide = replaced(wide, "gain", table.column("gain").cast(pa.float64()))
    wide = replaced(wide, "since_reload", pa.array([0.0, np.nan, 2.0]))  # as a data frame holds gaps
    wide = replaced(wide, "tool", table.column("tool").cast(pa.large_string()).dictionary_encode())
    wide = replaced(wide, "path", pa.array(table.column("path").to_pylist(), pa.list_(pa.list_(pa.float64()))))
    wide = replaced(wide, "window_m", pa.array(table.column("window_m").to_pylist(), pa.list_(pa.float64())))
    again = read_table(stored(tmp_path, wide), CONTRACT).table
    assert again.schema == table.schema
    assert again.column("since_reload").to_pylist() == [0, None, 2]
    assert again.column("path").to_pylist() == table.column("path").to_pylist()


def test_unknown_vectors_come_back_as_nan(tmp_path: Path) -> None:
    # A null of a fixed-size list can be written to Parquet by pyarrow but not read.
    rows = strokes.example_table(2).to_pylist()
    rows[1] |= {"color_srgb": None, "frame_size_px": None}
    table = pa.Table.from_pylist(rows, schema=strokes.example_table(0).schema)
    write_table(tmp_path / "t", table, CONTRACT, "# x")
    again = read_table(tmp_path / "t", CONTRACT).table
    assert np.isnan(again.column("color_srgb")[1].as_py()).all()
    assert again.column("frame_size_px")[1].as_py() == [0, 0]


def test_a_missing_column_is_named_with_its_type(tmp_path: Path) -> None:
    file = stored(tmp_path, strokes.example_table(2).drop_columns(["window_m"]))
    with pytest.raises(ContractError, match=r"lacks the required column 'window_m' \(float32\[4\]"):
        read_table(file, CONTRACT)


@pytest.mark.parametrize(
    ("name", "values", "says"),
    [
        ("order", pa.array(["0", "1"]), "column 'order' is string, but the strokes contract needs int32"),
        ("order", pa.array([0.5, 1.0]), "do not convert"),
        ("order", pa.array([2**40, 1]), "do not convert"),
        (
            "path",
            pa.array([[[0.0] * 3]] * 2, pa.list_(pa.list_(pa.float32(), 3))),
            r"needs list of float32\[5\]",
        ),
        ("path", pa.array([[[0.0] * 3]] * 2, pa.list_(pa.list_(pa.float32()))), "do not convert"),
        ("before", pa.array([b"x", b"y"]), "column 'before' is binary, but the strokes contract needs image"),
        ("tool", pa.array([1, 2]), "needs string"),
    ],
)
def test_a_wrong_type_is_named_with_the_right_one(tmp_path: Path, name: str, values: pa.Array, says: str) -> None:
    file = stored(tmp_path, replaced(strokes.example_table(2), name, values))
    with pytest.raises(ContractError, match=says):
        read_table(file, CONTRACT)


def test_reading_an_empty_folder_raises_contract_error(tmp_path: Path) -> None:
    with pytest.raises(ContractError, match=r"holds no \*\.parquet"):
        read_table(tmp_path, CONTRACT)
    with pytest.raises(ContractError, match=r"none\.parquet cannot be read as Parquet"):
        read_table(tmp_path / "none.parquet", CONTRACT)
    (tmp_path / "cut.parquet").write_bytes(b"PAR1")
    with pytest.raises(ContractError, match=r"cut\.parquet cannot be read as Parquet"):
        read_table(tmp_path / "cut.parquet", CONTRACT)


def with_bad_rows(rows: int, bad: int) -> pa.Table:
    """Demonstrations of which the last `bad` have an empty path."""
    table = demonstrations.example_table(4).take([row % 4 for row in range(rows)])
    points = table.column("points").to_pylist()
    points[rows - bad :] = [[]] * bad
    return replaced(table, "points", pa.array(points, table.schema.field("points").type))


@pytest.mark.parametrize(("rows", "bad"), [(2, 1), (20, 1), (199, 1), (200, 2), (300, 3)])
def test_up_to_one_percent_or_one_row_is_quarantined(tmp_path: Path, rows: int, bad: int) -> None:
    checked = read_table(stored(tmp_path, with_bad_rows(rows, bad)), demonstrations.CONTRACT)
    assert checked.table.num_rows == rows - bad
    assert [q.row for q in checked.quarantined] == list(range(rows - bad, rows))
    assert {q.reason for q in checked.quarantined} == {"points is empty"}


@pytest.mark.parametrize(("rows", "bad"), [(1, 1), (20, 2), (199, 2), (300, 4)])
def test_more_bad_rows_than_the_limit_raise_with_counts(tmp_path: Path, rows: int, bad: int) -> None:
    with pytest.raises(ContractError, match=f"{bad} of {rows} rows .*: {bad} x points is empty"):
        read_table(stored(tmp_path, with_bad_rows(rows, bad)), demonstrations.CONTRACT)


@pytest.mark.parametrize(("rows", "bad"), [(50, 1), (300, 3)])
def test_a_streamed_table_quarantines_the_rows_that_a_read_one_does(tmp_path: Path, rows: int, bad: int) -> None:
    path = stored(tmp_path, with_bad_rows(rows, bad))
    parts = [*stream_table(path, demonstrations.CONTRACT, 7)]
    assert (
        tuple(each for part in parts for each in part.quarantined)
        == read_table(path, demonstrations.CONTRACT).quarantined
    )
    path = stored(tmp_path, with_bad_rows(rows, bad + 2))
    with pytest.raises(ContractError, match=f"{bad + 2} of {rows} rows"):
        [*stream_table(path, demonstrations.CONTRACT, 7)]


def test_a_writer_bears_no_bad_row_and_leaves_the_old_table(tmp_path: Path) -> None:
    good = demonstrations.example_table(3)
    write_table(tmp_path / "t", good, demonstrations.CONTRACT, "# x")
    with pytest.raises(ContractError, match="1 of 300 rows to write"):
        write_table(tmp_path / "t", with_bad_rows(300, 1), demonstrations.CONTRACT, "# x")
    assert read_table(tmp_path / "t", demonstrations.CONTRACT).table.num_rows == 3


def test_an_empty_table_is_a_table(tmp_path: Path) -> None:
    write_table(tmp_path / "t", strokes.example_table(0), CONTRACT, "# x")
    assert read_table(tmp_path / "t", CONTRACT).table.num_rows == 0


MEASURED = os.environ.get("PENTIMENTO_MEASURED", "")
MEASURED_FILES = sorted(Path(MEASURED).glob("frida_strokes/*.parquet")) if MEASURED else []


@pytest.mark.skipif(
    not MEASURED_FILES,
    reason="NO MEASURED DATA: set PENTIMENTO_MEASURED to the folder that holds frida_strokes/*.parquet",
)
def test_measured_strokes_keep_the_contract() -> None:
    rows = 0
    for file in MEASURED_FILES:
        checked = read_table(file, CONTRACT)
        assert checked.quarantined == (), file.name
        assert set(checked.table.column("encoding").to_pylist()) == {"ink"}
        assert "far_ink_px" in checked.table.column_names  # a covariate
        rows += checked.table.num_rows
    assert rows >= 1000


@pytest.mark.parametrize("name", ["__index_level_0__", "Unnamed: 0", "index", ""])
def test_a_column_that_numbers_the_rows_is_no_covariate(tmp_path: Path, name: str) -> None:
    table = strokes.example_table(6)
    rows = list(range(6))
    wet = pa.array([0.1, 0.2, 0.3, 0.1, 0.2, 0.3])
    pq.write_table(table.append_column(name, pa.array(rows)).append_column("humidity", wet), tmp_path / "t.parquet")
    assert read_table(tmp_path / "t.parquet", strokes.CONTRACT).table.column_names[-1] == "humidity"
    assert is_index(name, [7, 3, 5]) and not is_index(name, [0.5, 1.0])
    assert is_index(name, [0, 1, 0, 1]) == (name != "index")  # of two frames, one below the other
    assert not is_index("humidity", rows) and not is_index(name, ["a", "b"])


def test_hidden_files_are_no_shards(tmp_path: Path) -> None:
    pq.write_table(strokes.example_table(3), tmp_path / "part-00000.parquet")
    (tmp_path / "._part-00000.parquet").write_bytes(b"of macOS")
    assert read_table(tmp_path, strokes.CONTRACT).table.num_rows == 3
