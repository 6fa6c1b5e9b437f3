"""Diagnose, make the strokes that would tell rivals apart, and diagnose again (GAP.md, rule 8)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import write_table
from pentimento.diagnosis.strokes.diagnose import Diagnosis
from pentimento.diagnosis.strokes.verdict import NEXT_ACTIONS

STROKES = "strokes"
"""Folder of the table with the rows that were added."""


def diagnose_in_rounds(
    table: pa.Table,
    out: Path,
    rounds: int,
    diagnosed: Callable[[pa.Table, str | None], Diagnosis],
    made: Callable[[pa.Table, pa.Table, int], pa.Table],
    log: Callable[[str], None],
) -> pa.Table:
    """Diagnose a table, and while an established cause has rivals add strokes to it, at most ``rounds`` times.

    What is in ``out`` in the end is of the last diagnosis, and the table that it is of is in ``out/strokes``, if it
    grew.

    Args:
        table: rows of the strokes contract.
        out: where ``diagnosed`` writes.
        rounds: at most.
        diagnosed: diagnoses a table with a note on how it grew, and writes what it found.
        made: rows for proposed actions (as in ``next_actions.parquet``), given the table so far and the round's number.
        log: gets a line for each round and for why there is no other.

    Returns:
        The table of the last diagnosis.
    """
    found = diagnosed(table, None)
    recorded = table.num_rows
    for number in range(1, rounds + 1):
        rivals = _open_questions(found)
        if not rivals:
            log("No established cause has rivals: no more strokes are needed.")
            break
        actions = pq.read_table(out / NEXT_ACTIONS)
        if actions.num_rows == 0:
            log("No strokes are proposed that could tell the rivals apart.")
            break
        log(f"Round {number}: {actions.num_rows} strokes to tell {', '.join(rivals)}.")
        rows = made(actions, table, number)
        if lost := _not_recorded(rows, table):
            log(f"The robot does not record {', '.join(lost)}: what depends on that cannot be asked any more.")
        table = pa.concat_tables([table, rows])
        card = f"# Strokes of a diagnosis\n\n{recorded} rows as they were given, {table.num_rows - recorded} added.\n"
        write_table(out / STROKES, table, CONTRACT, card)
        count = f"{number} round" + ("s" if number > 1 else "")
        found = diagnosed(table, f"{table.num_rows - recorded} of the strokes were made as proposed, in {count}.")
    return table


def _open_questions(found: Diagnosis) -> list[str]:
    """Established causes with rivals. Who has since been established beside a cause stands in nobody's place."""
    named = {finding.cause for finding in found.established}
    pairs = [(finding.cause, rival) for finding in found.established for rival in finding.rivals]
    return [f"{cause} from {rival}" for cause, rival in pairs if rival not in named]


def _not_recorded(rows: pa.Table, table: pa.Table) -> list[str]:
    """Columns that say something in the table and nothing in new rows, identities left out."""
    return [
        name
        for name in table.schema.names
        if not name.endswith("_id") and rows[name].null_count == rows.num_rows and table[name].null_count < len(table)
    ]
