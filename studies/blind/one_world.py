"""One blind world from its seed to its line in the results: made, sealed, judged by its table alone, opened."""

from __future__ import annotations

import hashlib
import io
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import PentimentoError
from studies.blind.elsewhere import shifted_table, with_actions, with_doubled, with_shuffled
from studies.blind.make import Truth, make_world, write_world
from studies.blind.series import Series, seed_of
from studies.blind.strength import StrengthError
from studies.blind.worlds import Sketch, sketch_world

ROOT = Path(__file__).parents[2]
LIMIT_S = 600
_LAST_WORDS = 1500


class SealError(PentimentoError):
    """A truth is not the one that was sealed before the verdict."""


class NoVerdict(PentimentoError):
    """The process that was given a table ended without a verdict."""


def judged(series: Series, index: int, commit: str, folder: Path) -> dict[str, Any]:
    """The line of one world. It has `redrawn` (why) where an effect cannot be as strong as it is wanted; `failed` where
    a table led to no verdict; else `truth`, `verdict`, and, where the series has one, the `second` verdict.
    """
    seed = seed_of(commit, series.name, index)
    line: dict[str, Any] = {"series": series.name, "index": index, "seed": seed}
    cause = series.causes[index % len(series.causes)] if series.causes else None
    started = time.process_time()
    try:
        sketch = sketch_world(series.stratum, seed, cause, q=series.q)
        table, truth = make_world(sketch)
        doubled = with_doubled(sketch, truth, table) if series.second == "doubled effect" else None
    except StrengthError as reason:
        return line | {"redrawn": str(reason)}
    line["make_s"] = round(time.process_time() - started, 2)
    shown, test_split = folder / "shown", folder / "test_split"
    for part in (shown, test_split):
        part.mkdir(parents=True)
    write_world(test_split, table, truth)
    (test_split / "table.parquet").rename(shown / "table.parquet")
    line["seal"] = (test_split / "truth.sha256").read_text().strip()
    try:
        line |= _first(series, sketch, truth, shown)
        if series.second is not None:
            line["second"] = _second(series, sketch, truth, table, doubled, folder)["verdict"]
    except NoVerdict as reason:
        line["failed"] = str(reason)
    return line | {"truth": opened(test_split / "truth.json", line["seal"])}


def opened(path: Path, seal: str) -> dict[str, Any]:
    """A truth, once the verdict is there.

    Raises SealError if it is not the one that was sealed.
    """
    content = path.read_bytes()
    if hashlib.sha256(content).hexdigest() != seal:
        raise SealError(f"{path} is not what was sealed before the verdict; make and judge this world again.")
    truth: dict[str, Any] = json.loads(content)
    return truth


def verdict_by_table(table: Path, *options: str, module: str = "studies.blind.verdict_of") -> dict[str, Any]:
    """What a process of its own, given a folder with the table alone, says; `module` is what it runs.

    Raises NoVerdict with its last words if it says nothing.
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
        raise NoVerdict(f"The diagnosis ended with {done.returncode}: {done.stderr.strip()[-_LAST_WORDS:]}")
    said: dict[str, Any] = json.loads(out.read_text())
    return said


def _first(series: Series, sketch: Sketch, truth: Truth, shown: Path) -> dict[str, Any]:
    options: list[str] = []
    if series.shifted:
        write_parquet(shown / "shifted.parquet", shifted_table(sketch, truth))
        options = ["--test", "shifted.parquet"]
    if series.second == "more actions":
        options = ["--next-actions", "next_actions.parquet"]
    return verdict_by_table(shown / "table.parquet", *options)


def _second(
    series: Series, sketch: Sketch, truth: Truth, table: pa.Table, doubled: pa.Table | None, folder: Path
) -> dict[str, Any]:
    again = folder / "again" / "table.parquet"
    again.parent.mkdir()
    match series.second:
        case "more actions":
            actions = pq.read_table(folder / "shown" / "next_actions.parquet")
            table = with_actions(sketch, truth, table, actions)
        case "shuffled covariate":
            table = with_shuffled(table, sketch.causes[0], sketch.seed)
        case "doubled effect":
            assert doubled is not None
            table = doubled
    write_parquet(again, table)
    return verdict_by_table(again, *(["--without", sketch.causes[0]] if series.second == "deleted candidate" else []))


def write_parquet(path: Path, table: pa.Table) -> None:
    """A table as a file, whole or not there."""
    buffer = io.BytesIO()
    pq.write_table(table, buffer, compression="zstd")
    atomic_write(path, buffer.getvalue())
