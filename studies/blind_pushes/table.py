"""The blind table of pushes: `python -m studies.blind_pushes.table [--worlds 0.1] [--out data/studies/blind_pushes]`.

As `studies.blind.table` makes it of strokes: worlds of every series by seeds that follow from the commit, each judged
by its table alone, each world's line appended to <out>/<commit>.jsonl as soon as it is there, so that the table can be
interrupted. Writes docs/blind_pushes.md; a part of the table has its page beside its lines, in <out>.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
import tempfile
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from pathlib import Path

from pentimento.contracts.atomic import atomic_write
from pipelines._io import end_with_parent
from studies.blind.one_world import ROOT
from studies.blind.table import Line, code, commit_of_head, lines_of, mend, missing
from studies.blind_pushes.one_world import judged
from studies.blind_pushes.page import page
from studies.blind_pushes.series import SERIES, Series

PAGE = ROOT / "docs" / "blind_pushes.md"


def run(commit: str, share: float, path: Path, workers: int) -> None:
    """Make and judge what is missing of a `share` of the table, and append it to `path`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    mend(path)
    lines = [line for line in lines_of(path) if "failed" not in line]
    for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[name] = "1"  # inherited by the workers, which are fresh processes, and by theirs
    version = code()
    under_way: dict[Future[Line], Line] = {}
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), end_with_parent) as pool:
        while True:
            _submit(pool, commit, share, lines, under_way, workers)
            if not under_way:
                return
            for future in wait(under_way, return_when=FIRST_COMPLETED).done:
                placeholder = under_way.pop(future)
                line = future.result() | {"commit": commit, "code": version}
                lines[lines.index(placeholder)] = line
                with path.open("a") as file:
                    file.write(json.dumps(line) + "\n")
                _tell(line)


def wanted(series: Series, share: float) -> int:
    """How many of its worlds make a `share` of the table: at least one."""
    return max(round(series.worlds * share), 1)


def _submit(
    pool: Executor, commit: str, share: float, lines: list[Line], under_way: dict[Future[Line], Line], workers: int
) -> None:
    """Fill the workers: series after series."""
    for series in SERIES:
        for index in missing(series, wanted(series, share), lines):
            if len(under_way) >= workers:
                return
            placeholder: Line = {"series": series.name, "index": index}
            lines.append(placeholder)
            under_way[pool.submit(_in_scratch, series, index, commit)] = placeholder


def _in_scratch(series: Series, index: int, commit: str) -> Line:
    with tempfile.TemporaryDirectory() as folder:
        return judged(series, index, commit, Path(folder))


def _tell(line: Line) -> None:
    name = f"{line['series']} {line['index']}"
    if "redrawn" in line:
        print(f"{name}: drawn again, {line['redrawn']}", flush=True)
    elif "failed" in line:
        print(f"{name}: {line['failed']}", flush=True)
    else:
        truth, said = line["truth"], line["verdict"]
        hidden = " + ".join(truth["causes"]) or str(truth["outside"])
        named = " + ".join(entry["cause"] for entry in said["established"]) or "nothing"
        print(f"{name}: hidden {hidden}, named {named} ({line['make_s']} + {line['seconds']} s)", flush=True)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.blind_pushes.table", description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "data" / "studies" / "blind_pushes")
    parser.add_argument("--worlds", type=float, default=1.0, help="share of each series: 0.1 for a quick look")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--commit", help="go on with the seeds of this commit; default: the one checked out")
    given = parser.parse_args()
    if not 0 < given.worlds <= 1:
        sys.exit("--worlds is a share of the table, above 0 and at most 1.")
    commit = given.commit or commit_of_head()
    path = given.out / f"{commit[:12]}.jsonl"
    run(commit, given.worlds, path, given.workers)
    written = PAGE if given.worlds == 1 else path.with_suffix(".md")
    atomic_write(written, page(lines_of(path), commit).encode())
    print(f"{written} is written from {path}.")


if __name__ == "__main__":
    main()
