"""One blind clay world from its seed to its line in the results: made, sealed, judged by its table alone, opened."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pentimento.contracts.errors import ContractError
from studies.blind.make import write_world
from studies.blind.one_world import NoVerdict, opened, verdict_by_table, write_parquet
from studies.blind.series import seed_of
from studies.blind.strength import StrengthError
from studies.blind_pushes.make import make_world, recorded
from studies.blind_pushes.series import COLUMNS, Series
from studies.blind_pushes.worlds import sketch_world

VERDICT_OF = "studies.blind_pushes.verdict_of"


def judged(series: Series, index: int, commit: str, folder: Path) -> dict[str, Any]:
    """The line of one world. It has `redrawn` (why) where an effect cannot be as strong as it is wanted, or the robot
    cannot go on; `failed` where a table led to no verdict; else `truth`, `verdict`, and, where the series has one, the
    `second` verdict.
    """
    seed = seed_of(commit, f"pushes, {series.name}", index)
    line: dict[str, Any] = {"series": series.name, "index": index, "seed": seed}
    cause = series.causes[index % len(series.causes)] if series.causes else None
    started = time.process_time()
    sketch = sketch_world(series.stratum, seed, cause, series.q)
    try:
        table, truth = make_world(sketch)
    except (StrengthError, ContractError) as reason:  # the latter: its scanner left a hole where a push should go
        return line | {"redrawn": str(reason)}
    line["make_s"] = round(time.process_time() - started, 2)
    shown, test_split = folder / "shown", folder / "test_split"
    for part in (shown, test_split):
        part.mkdir(parents=True)
    write_world(test_split, table, truth)
    (test_split / "table.parquet").rename(shown / "table.parquet")
    line["seal"] = (test_split / "truth.sha256").read_text().strip()
    try:
        line |= verdict_by_table(shown / "table.parquet", module=VERDICT_OF)
        if series.second is not None:
            again = folder / "again" / "table.parquet"
            again.parent.mkdir()
            options: list[str] = []
            match series.second:
                case "shuffled covariate":
                    table = with_shuffled(table, sketch.causes[0], seed)
                case "doubled effect":
                    table = recorded(sketch, truth, times=2.0)
                case "deleted candidate":
                    options = ["--without", sketch.causes[0]]
            write_parquet(again, table)
            line["second"] = verdict_by_table(again, *options, module=VERDICT_OF)["verdict"]
    except NoVerdict as reason:
        line["failed"] = str(reason)
    return line | {"truth": opened(test_split / "truth.json", line["seal"])}


def with_shuffled(table: pa.Table, cause: str, seed: int) -> pa.Table:
    """The table with the covariate of a cause (one of `COLUMNS`) dealt out to the rows anew, times too."""
    order = np.random.default_rng([seed, 41]).permutation(table.num_rows)
    for name in COLUMNS[cause]:
        at = table.column_names.index(name)
        table = table.set_column(at, table.schema.field(name), table[name].take(order))
    return table
