"""The blind table: `python -m studies.blind.table [--worlds 0.1] [--out data/studies/blind]`.

Draws the worlds of every series by seeds that follow from the commit, has each judged by its table alone, and writes
docs/blind_tests.md; a part of the table has its page beside its lines, in <out>. Each world's line is appended to
<out>/<commit>.jsonl as soon as it is there; what stands in that file is not made again, so that the table can be
interrupted. A world without a verdict is tried again.
"""

import argparse
import hashlib
import json
import multiprocessing
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from pathlib import Path
from typing import Any, Protocol

from pentimento.contracts.atomic import atomic_write
from pipelines._io import end_with_parent
from studies.blind.one_world import ROOT, judged
from studies.blind.page import page
from studies.blind.series import SERIES, Series, wanted

Line = dict[str, Any]

PAGE = ROOT / "docs" / "blind_tests.md"


def commit_of_head() -> str:
    """The hash of the commit that is checked out."""
    done = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def code() -> str:
    """A digest of all that makes and judges a world: verdicts of different code do not belong in one table."""
    digest = hashlib.sha256()
    for folder in (ROOT / "src", ROOT / "studies"):
        for path in sorted(folder.rglob("*")):
            if path.suffix in (".py", ".toml"):
                digest.update(str(path.relative_to(ROOT)).encode() + path.read_bytes())
    return digest.hexdigest()[:12]


def lines_of(path: Path) -> list[Line]:
    """What is known, the last line of each world; a last line that was cut off while it was written is left out."""
    if not path.exists():
        return []
    known: dict[tuple[str, int], Line] = {}
    for text in path.read_text().splitlines(keepends=True):
        if not text.endswith("\n"):
            break
        line = json.loads(text)
        known[line["series"], line["index"]] = line
    return list(known.values())


class Named(Protocol):
    """A series, as far as this goes."""

    @property
    def name(self) -> str:
        """In the lines."""


def missing(series: Named, count: int, lines: Sequence[Line]) -> Iterator[int]:
    """Indices of worlds to be made next, in order, for as long as those that may still come to something are too few.

    `lines` is looked at anew each time; the caller adds a line {"series", "index"} for each world under way.
    """
    index = 0
    while True:
        own = [line for line in lines if line["series"] == series.name]
        if sum("redrawn" not in line for line in own) >= count:
            return
        taken = {line["index"] for line in own}
        while index in taken:
            index += 1
        yield index


def run(commit: str, share: float, path: Path, workers: int) -> None:
    """Make and judge what is missing of a `share` of the table, and append it to `path`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    mend(path)
    lines = [line for line in lines_of(path) if "failed" not in line]
    for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[name] = "1"  # inherited by the workers, which are fresh processes, and by theirs
    under_way: dict[Future[Line], Line] = {}
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context, end_with_parent) as pool:
        while True:
            _submit(pool, commit, share, lines, under_way, workers)
            if not under_way:
                return
            for future in wait(under_way, return_when=FIRST_COMPLETED).done:
                placeholder = under_way.pop(future)
                line = future.result() | {"commit": commit, "code": code()}
                lines[lines.index(placeholder)] = line
                with path.open("a") as file:
                    file.write(json.dumps(line) + "\n")
                _tell(line)


def _submit(
    pool: Executor,
    commit: str,
    share: float,
    lines: list[Line],
    under_way: dict[Future[Line], Line],
    workers: int,
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


def mend(path: Path) -> None:
    """Drop a last line that was cut off."""
    if path.exists():
        data = path.read_bytes()
        if not data.endswith(b"\n"):
            atomic_write(path, data[: data.rfind(b"\n") + 1])


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
    parser = argparse.ArgumentParser(prog="python -m studies.blind.table", description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "data" / "studies" / "blind")
    parser.add_argument("--worlds", type=float, default=1.0, help="share of each series: 0.1 for a quick look")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--commit", help="go on with the seeds of this commit; default: the one checked out")
    given = parser.parse_args()
    if not 0 < given.worlds <= 1:
        sys.exit("--worlds is a share of the table, above 0 and at most 1.")
    commit = given.commit or commit_of_head()
    path = given.out / f"{commit[:12]}.jsonl"
    run(commit, given.worlds, path, given.workers)
    whole = given.worlds == 1
    written = PAGE if whole else path.with_suffix(".md")
    atomic_write(written, page(lines_of(path), commit).encode())
    print(f"{written} is written from {path}.")


if __name__ == "__main__":
    main()
