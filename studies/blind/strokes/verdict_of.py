"""The verdict on one table of strokes: `python -m studies.blind.strokes.verdict_of table.parquet verdict.json`.

Runs in a process of its own, which gets the table alone. Does what `pentimento diagnose` does, without the report, and
adds the causes that simpler methods name.
"""

import argparse
import io
import json
import time
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.diagnosis.diagnose import diagnose
from pentimento.diagnosis.strokes.measured import load_measured
from pentimento.diagnosis.strokes.next_actions import as_table, proposal_for, screen
from pentimento.diagnosis.strokes.out_of_distribution import gap_closed_outside
from pentimento.diagnosis.strokes.problem import StrokeProblem, StrokeResult, stroke_problem
from pentimento.diagnosis.strokes.quarantine import usable_rows
from pentimento.diagnosis.verdict import verdict
from pentimento.dynamics.strokes.mechanisms import VOCABULARY
from studies.blind.rivals import named_by_rivals


class Diagnosed(NamedTuple):
    """Diagnosis of a table."""

    verdict: dict[str, Any]
    problem: StrokeProblem
    """The rows that could be used."""
    result: StrokeResult


def verdict_on(table: pa.Table, seed: int, outside: pa.Table | None = None, without: str | None = None) -> Diagnosed:
    """The verdict on rows of the strokes contract.

    Args:
        outside: a table out of distribution, on which the fraction of the gap closed is measured, too.
        without: a cause to remove from the vocabulary.
    """
    vocabulary = [kind for kind in VOCABULARY if kind.cause != without]
    problem = stroke_problem(load_measured(usable_rows(table).table), vocabulary, seed)
    result = diagnose(problem, seed=seed, log=lambda line: None)
    shifted = None
    if outside is not None:
        shifted = gap_closed_outside(load_measured(usable_rows(outside).table), problem, result)
    return Diagnosed(verdict(result, shifted=shifted), problem, result)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.blind.strokes.verdict_of", description=__doc__)
    parser.add_argument("table", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--test", type=Path, help="a table out of distribution")
    parser.add_argument("--without", help="a cause to remove from the vocabulary")
    parser.add_argument("--next-actions", type=Path, help="file for the proposed actions")
    given = parser.parse_args()
    table = read_table(given.table, CONTRACT).table
    outside = None if given.test is None else read_table(given.test, CONTRACT).table
    started = time.process_time()  # not wall time: other processes may run on the machine
    content, problem, result = verdict_on(table, given.seed, outside, given.without)
    seconds = time.process_time() - started
    if given.next_actions is not None:
        buffer = io.BytesIO()
        pq.write_table(as_table(proposal_for(result, screen(result), given.seed), problem.measured), buffer)
        atomic_write(given.next_actions, buffer.getvalue())
    values = int(problem.measured.samples.valid.numpy().sum((1, 2)).mean()) * 3
    rivals = named_by_rivals(result.known, result.base, values)
    output = {"verdict": content, "rivals": rivals, "seconds": round(seconds, 2)}
    atomic_write(given.out, (json.dumps(output) + "\n").encode())


if __name__ == "__main__":
    main()
