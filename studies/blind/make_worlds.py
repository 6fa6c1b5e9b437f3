"""Worlds of the benchmark for anybody's method: `python -m studies.blind.make_worlds strokes --text TEXT --out WORLDS`.

WORLDS/<number>/ gets `table.parquet`, `truth.json` and `series.json` (docs/benchmark_diagnosis.md).
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import get_args

from pentimento.contracts.atomic import atomic_write
from studies.blind.kinds import KindName, kind_of
from studies.blind.series import seed_of, wanted
from studies.blind.truth import write_world


def main() -> None:
    """Command line: make the worlds of the series that a single verdict decides."""
    parser = argparse.ArgumentParser(prog="python -m studies.blind.make_worlds", description=__doc__)
    parser.add_argument("kind", choices=get_args(KindName))
    parser.add_argument("--text", required=True, help="from which the seeds follow, such as the hash of a commit")
    parser.add_argument("--worlds", type=float, default=0.1, help="share of each series")
    parser.add_argument("--out", required=True, type=Path)
    given = parser.parse_args()
    if not 0 < given.worlds <= 1:
        sys.exit("--worlds is a share of the benchmark, above 0 and at most 1.")
    kind, number = kind_of(given.kind), 0
    for series in kind.series:
        made, index = 0, 0
        while series.second is None and made < wanted(series, given.worlds):
            seed = seed_of(given.text, kind.seed_prefix + series.name, index)
            index += 1
            try:
                table, truth = kind.make(kind.sketch(series.stratum, seed, None, series.q))
            except kind.cannot_be_made:
                continue
            folder = given.out / f"{number:04d}"
            write_world(folder, table, truth)
            about = {"kind": kind.name, "series": series.name}
            atomic_write(folder / "series.json", (json.dumps(about) + "\n").encode())
            made, number = made + 1, number + 1
            print(folder, flush=True)


if __name__ == "__main__":
    main()
