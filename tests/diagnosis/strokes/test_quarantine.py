"""Bad rows are left out by name, too many are an error, copies are no repeats."""

from typing import Any

import pyarrow as pa
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.strokes.quarantine import usable_rows

TABLE = example_table(12)


def changed(rows: dict[int, dict[str, Any]], table: pa.Table = TABLE) -> pa.Table:
    """The table with other values in some rows."""
    return pa.Table.from_pylist(
        [row | rows.get(number, {}) for number, row in enumerate(table.to_pylist())], schema=table.schema
    )


OUTSIDE = {"window_m": [1.0, 1.0, 1.08, 1.056]}
STILL = {"path": [[t, 0.1, 0.1, -0.001, 0.0] for t in (0.0, 0.5, 1.0)]}


def test_usable_rows_pass_unchanged() -> None:
    sound = usable_rows(TABLE)
    assert sound.table is TABLE and not sound.bad and not sound.copies and sound.sentences() == []


@pytest.mark.parametrize(("fault", "says"), [(OUTSIDE, "indow"), (STILL, "does not move")])
def test_single_bad_row_is_left_out_and_named(fault: dict[str, Any], says: str) -> None:
    sound = usable_rows(changed({4: fault}))
    assert list(sound.bad) == [4] and says in sound.bad[4]
    assert sound.table["order"].to_pylist() == [n for n in range(12) if n != 4]
    assert "Row 4" in sound.sentences()[0]


def test_rejects_too_many_bad_rows_by_name() -> None:
    with pytest.raises(ContractError, match=r"Rows 2, 5 .*does not move"):
        usable_rows(changed({2: STILL, 5: STILL}))


def test_copies_are_left_out() -> None:
    sound = usable_rows(pa.concat_tables([TABLE, TABLE]))
    assert sound.copies == tuple(range(12, 24)) and sound.table.num_rows == 12
    assert "and 4 more" in sound.sentences()[0]


def test_repeated_action_is_no_copy() -> None:
    """Another photograph of the same command contributes to the noise floor."""
    assert usable_rows(changed({1: {"path": TABLE["path"][0].as_py(), "action_id": 0}})).copies == ()


def test_empty_table_stays_empty() -> None:
    assert usable_rows(TABLE.slice(0, 0)).table.num_rows == 0


def test_strokes_without_visible_mark_are_counted() -> None:
    before = {n: {"after": row["before"]} for n, row in enumerate(TABLE.to_pylist()) if n < 6}
    sound = usable_rows(changed(before))
    assert sound.unmarked == 6 and sound.table.num_rows == 12
    assert "6 of 12 rows show no mark" in sound.sentences()[0]
