"""The blind benchmark: `python -m studies.blind.table strokes|pushes [--worlds 0.1] [--out FOLDER]`.

Draws the worlds of every series by seeds that follow from the commit, has each diagnosed from its table alone, and
writes docs/blind_tests.md (strokes) or docs/blind_pushes.md; the page of a part of the benchmark goes to FOLDER. Each
world's line is appended to FOLDER/<commit>.jsonl as soon as it is known, and worlds with a line are not made again, so
that the benchmark can be interrupted. Worlds without a verdict are tried again.
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
from typing import Any, get_args

from pentimento.contracts.atomic import atomic_write
from pipelines._io import end_with_parent
from studies.blind.kinds import Kind, KindName, kind_of
from studies.blind.one_world import ROOT, diagnose_world
from studies.blind.page import page
from studies.blind.series import Series, wanted

Line = dict[str, Any]


def commit_of_head() -> str:
    """The hash of the commit that is checked out."""
    done = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def digest_of_code() -> str:
    """A digest of all code that makes and diagnoses a world: one table should hold verdicts of one version."""
    digest = hashlib.sha256()
    for folder in (ROOT / "src", ROOT / "studies"):
        for path in sorted(folder.rglob("*")):
            if path.suffix in (".py", ".toml"):
                digest.update(str(path.relative_to(ROOT)).encode() + path.read_bytes())
    return digest.hexdigest()[:12]


def read_lines(path: Path) -> list[Line]:
    """The last line of each world; a final line that was cut off is ignored."""
    if not path.exists():
        return []
    known: dict[tuple[str, int], Line] = {}
    for text in path.read_text().splitlines(keepends=True):
        if not text.endswith("\n"):
            break
        line = json.loads(text)
        known[line["series"], line["index"]] = line
    return list(known.values())


def missing(series: Series, count: int, lines: Sequence[Line]) -> Iterator[int]:
    """Indices of the worlds to make next, in order, until `count` worlds are made or in progress.

    `lines` is read again at each step; the caller adds a line {"series", "index"} for each world in progress.
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


def run(kind: Kind, commit: str, share: float, path: Path, workers: int) -> None:
    """Make and diagnose what is missing of a `share` of the benchmark, and append it to `path`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    _drop_cut_off_line(path)
    lines = [line for line in read_lines(path) if "failed" not in line]
    for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[name] = "1"  # inherited by the workers, which are fresh processes, and by theirs
    version = digest_of_code()
    in_progress: dict[Future[Line], Line] = {}
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context, end_with_parent) as pool:
        while True:
            for series, index in _to_submit(kind, share, lines, workers - len(in_progress)):
                lines.append({"series": series.name, "index": index})
                in_progress[_submit(pool, kind, series, index, commit)] = lines[-1]
            if not in_progress:
                return
            for future in wait(in_progress, return_when=FIRST_COMPLETED).done:
                placeholder = in_progress.pop(future)
                line = future.result() | {"commit": commit, "code": version}
                lines[lines.index(placeholder)] = line
                with path.open("a") as file:
                    file.write(json.dumps(line) + "\n")
                _print_line(line)


def _to_submit(kind: Kind, share: float, lines: list[Line], free: int) -> Iterator[tuple[Series, int]]:
    """Worlds for the `free` workers, series after series; the caller adds each to `lines`."""
    for series in kind.series:
        for index in missing(series, wanted(series, share), lines):
            if free == 0:
                return
            free -= 1
            yield series, index


def _submit(pool: Executor, kind: Kind, series: Series, index: int, commit: str) -> Future[Line]:
    return pool.submit(_in_temporary_folder, kind.name, series, index, commit)


def _in_temporary_folder(name: KindName, series: Series, index: int, commit: str) -> Line:
    with tempfile.TemporaryDirectory() as folder:
        return diagnose_world(kind_of(name), series, index, commit, Path(folder))


def _drop_cut_off_line(path: Path) -> None:
    if path.exists():
        data = path.read_bytes()
        if not data.endswith(b"\n"):
            atomic_write(path, data[: data.rfind(b"\n") + 1])


def _print_line(line: Line) -> None:
    name = f"{line['series']} {line['index']}"
    if "redrawn" in line:
        print(f"{name}: drawn again, {line['redrawn']}", flush=True)
    elif "failed" in line:
        print(f"{name}: {line['failed']}", flush=True)
    else:
        truth, verdict = line["truth"], line["verdict"]
        hidden = " + ".join(truth["causes"]) or str(truth["outside"])
        named = " + ".join(entry["cause"] for entry in verdict["established"]) or "nothing"
        print(f"{name}: hidden {hidden}, named {named} ({line['make_s']} + {line['seconds']} s)", flush=True)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.blind.table", description=__doc__)
    parser.add_argument("kind", choices=get_args(KindName))
    parser.add_argument("--out", type=Path, help="default: data/studies/blind_<kind>")
    parser.add_argument("--worlds", type=float, default=1.0, help="share of each series: 0.1 for a quick look")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--commit", help="continue with the seeds of this commit; default: the one checked out")
    args = parser.parse_args()
    if not 0 < args.worlds <= 1:
        sys.exit("--worlds is a share of the benchmark, above 0 and at most 1.")
    kind, commit = kind_of(args.kind), args.commit or commit_of_head()
    folder = args.out or ROOT / "data" / "studies" / f"blind_{kind.name}"
    path = folder / f"{commit[:12]}.jsonl"
    run(kind, commit, args.worlds, path, args.workers)
    out = ROOT / kind.page if args.worlds == 1 else path.with_suffix(".md")
    atomic_write(out, page(kind, read_lines(path), commit).encode())
    print(f"{out} is written from {path}.")


if __name__ == "__main__":
    main()
