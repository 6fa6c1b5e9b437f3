"""One simulated world, from its seed to its line in the results.

The world is made, the truth's hash recorded, the table alone diagnosed in a process of its own, and the truth read.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pentimento.contracts.errors import PentimentoError
from studies.blind.kinds import Kind
from studies.blind.series import COLUMNS, Series, seed_of
from studies.blind.strokes.other_tables import shifted_table, with_actions
from studies.blind.truth import Truth, read_truth, write_parquet, write_world

ROOT = Path(__file__).parents[2]
LIMIT_S = 600  # of a diagnosis; the slowest on record took a minute
_STDERR_TAIL = 1500  # characters


class NoVerdict(PentimentoError):
    """The process that was given a table ended without a verdict."""


def diagnose_world(kind: Kind, series: Series, index: int, commit: str, folder: Path) -> dict[str, Any]:
    """The line of one world.

    It has `redrawn` (why) where the world cannot be made, `failed` where a table led to no verdict, and otherwise
    `truth`, `verdict` and, where the series has one, the `second` verdict.
    """
    seed = seed_of(commit, kind.seed_prefix + series.name, index)
    line: dict[str, Any] = {"series": series.name, "index": index, "seed": seed}
    cause = series.causes[index % len(series.causes)] if series.causes else None
    started = time.process_time()
    try:
        sketch = kind.sketch(series.stratum, seed, cause, series.q)
        table, truth = kind.make(sketch)
        doubled = kind.doubled(sketch, truth, table) if series.second == "doubled effect" else None
    except kind.cannot_be_made as reason:
        return line | {"redrawn": str(reason)}
    line["make_s"] = round(time.process_time() - started, 2)
    hidden, shown = folder / "hidden", folder / "shown"
    for part in (shown, hidden):
        part.mkdir(parents=True)
    write_world(hidden, table, truth)
    (hidden / "table.parquet").rename(shown / "table.parquet")
    line["truth_sha256"] = (hidden / "truth.sha256").read_text().strip()
    try:
        line |= _first_verdict(kind, series, sketch, truth, shown)
        if series.second is not None:
            second = doubled if doubled is not None else _second_table(series, sketch, truth, table, shown)
            options = ["--without", sketch.causes[0]] if series.second == "deleted candidate" else []
            write_parquet(folder / "again" / "table.parquet", second)
            again = folder / "again" / "table.parquet"
            line["second"] = verdict_by_table(again, *options, module=kind.verdict_module)["verdict"]
    except NoVerdict as reason:
        line["failed"] = str(reason)
    return line | {"truth": read_truth(hidden / "truth.json", line["truth_sha256"])}


def verdict_by_table(table: Path, *options: str, module: str) -> dict[str, Any]:
    """Diagnose a table in a process of its own, which gets the table's folder alone; `module` is what it runs.

    Raises NoVerdict with the end of its standard error if it writes no verdict.
    """
    out = table.with_name("verdict.json")
    command = [sys.executable, "-m", module, table.name, out.name, *options]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT / "src"), str(ROOT)])}
    try:
        done = subprocess.run(
            command, cwd=table.parent, env=environment, capture_output=True, text=True, timeout=LIMIT_S, check=False
        )
    except subprocess.TimeoutExpired as late:
        raise NoVerdict(f"No verdict after {LIMIT_S} s.") from late
    if done.returncode:
        raise NoVerdict(f"The diagnosis ended with {done.returncode}: {done.stderr.strip()[-_STDERR_TAIL:]}")
    result: dict[str, Any] = json.loads(out.read_text())
    return result


def with_shuffled(table: pa.Table, cause: str, seed: int) -> pa.Table:
    """The table with the columns of a cause (a key of `COLUMNS`) permuted over the rows, all by one permutation."""
    order = np.random.default_rng([seed, 41]).permutation(table.num_rows)
    for name in COLUMNS[cause]:
        if name in table.column_names:
            at = table.column_names.index(name)
            table = table.set_column(at, table.schema.field(name), table[name].take(order))
    return table


def _first_verdict(kind: Kind, series: Series, sketch: Any, truth: Truth, shown: Path) -> dict[str, Any]:
    options: list[str] = []
    if series.shifted:
        write_parquet(shown / "shifted.parquet", shifted_table(sketch, truth))
        options = ["--test", "shifted.parquet"]
    if series.second == "more actions":
        options = ["--next-actions", "next_actions.parquet"]
    return verdict_by_table(shown / "table.parquet", *options, module=kind.verdict_module)


def _second_table(series: Series, sketch: Any, truth: Truth, table: pa.Table, shown: Path) -> pa.Table:
    match series.second:
        case "more actions":
            return with_actions(sketch, truth, table, pq.read_table(shown / "next_actions.parquet"))
        case "shuffled covariate":
            return with_shuffled(table, sketch.causes[0], sketch.seed)
        case _:
            return table
