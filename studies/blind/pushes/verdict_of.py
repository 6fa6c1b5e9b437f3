"""The verdict on one table of pushes: `python -m studies.blind.pushes.verdict_of table.parquet verdict.json`.

Runs in a process of its own, which gets the table alone. Does what `pentimento diagnose` does, without the report, and
adds the causes that simpler methods name.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import pyarrow as pa

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.pushes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.diagnosis.diagnose import diagnose
from pentimento.diagnosis.pushes.problem import PushResult, push_problem
from pentimento.diagnosis.pushes.write import usable
from pentimento.diagnosis.verdict import verdict
from pentimento.planning.pushes.analytic.mechanisms import VOCABULARY
from studies.blind.rivals import named_by_rivals

_SIDE_PX = 64
"""Side of the windows of the diagnosis."""


def verdict_on(table: pa.Table, seed: int, without: str | None = None) -> tuple[dict[str, Any], PushResult]:
    """The verdict on rows of the pushes contract; `without` removes a cause from the vocabulary."""
    measured, _ = usable(table)
    vocabulary = [kind for kind in VOCABULARY if kind.cause != without]
    result = diagnose(push_problem(measured, vocabulary, seed), seed=seed, log=lambda line: None)
    return verdict(result), result


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.blind.pushes.verdict_of", description=__doc__)
    parser.add_argument("table", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--without", help="a cause to remove from the vocabulary")
    given = parser.parse_args()
    table = read_table(given.table, CONTRACT).table
    started = time.process_time()  # not wall time: other processes may run on the machine
    content, result = verdict_on(table, given.seed, given.without)
    seconds = time.process_time() - started
    rivals = named_by_rivals(result.known, result.base, _SIDE_PX**2)
    output = {"verdict": content, "rivals": rivals, "seconds": round(seconds, 2)}
    atomic_write(given.out, (json.dumps(output) + "\n").encode())


if __name__ == "__main__":
    main()
