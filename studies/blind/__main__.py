"""The benchmark for anybody's method (docs/benchmark_diagnosis.md).

`python -m studies.blind make strokes --text TEXT --worlds 0.1 --out WORLDS` makes worlds: WORLDS/<number>/ holds
`table.parquet` and `truth.json`. `python -m studies.blind score WORLDS VERDICTS` compares VERDICTS/<number>.json with
the truths: each is a `verdict.json` of `pentimento diagnose`, or has its keys `established` and `unexplained`.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

from studies.blind.binomial import interval
from studies.blind.kinds import KindName, kind_of
from studies.blind.page import simpler_methods
from studies.blind.score_card import rows
from studies.blind.series import seed_of, wanted
from studies.blind.truth import write_world


def main(arguments: Sequence[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.blind", description=__doc__)
    commands = parser.add_subparsers(required=True)
    maker = commands.add_parser("make", help="make worlds")
    maker.add_argument("kind", choices=get_args(KindName))
    maker.add_argument("--text", required=True, help="from which the seeds follow, such as the hash of a commit")
    maker.add_argument("--worlds", type=float, default=0.1, help="share of each series")
    maker.add_argument("--out", required=True, type=Path)
    maker.set_defaults(run=make)
    scorer = commands.add_parser("score", help="compare verdicts with truths")
    scorer.add_argument("worlds", type=Path)
    scorer.add_argument("verdicts", type=Path)
    scorer.set_defaults(run=score)
    given = parser.parse_args(arguments)
    given.run(given)


def make(given: argparse.Namespace) -> None:
    """Make the worlds of the series that a single verdict decides."""
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
            (folder / "series.json").write_text(json.dumps({"kind": kind.name, "series": series.name}) + "\n")
            made, number = made + 1, number + 1
            print(folder, flush=True)


def score(given: argparse.Namespace) -> None:
    """Print the rows of the score card."""
    lines, kinds = [], set()
    for folder in sorted(path.parent for path in given.worlds.glob("*/truth.json")):
        about = json.loads((folder / "series.json").read_text())
        kinds.add(about["kind"])
        line = {
            "series": about["series"],
            "index": len(lines),
            "truth": json.loads((folder / "truth.json").read_text()),
        }
        lines.append(line | _verdict(given.verdicts / f"{folder.name}.json"))
    if len(kinds) != 1:
        sys.exit(f"{given.worlds} holds worlds of {len(kinds)} kinds, not of one: make them with `make`.")
    for row in rows(kind_of(kinds.pop()), lines):
        low, high = interval(row.hits, row.of)
        print(f"{row.what}: {row.hits} of {row.of} ({low:.0%} to {high:.0%})")
    print(simpler_methods(lines))


def _verdict(path: Path) -> dict[str, Any]:
    """The verdict of a world; a world without one counts as missed."""
    if not path.exists():
        return {}
    told = json.loads(path.read_text())
    entries = [{"rivals": [], "gain": 0.0} | entry for entry in told["established"]]
    nothing = {"unexplained": [], "floor_reached": None, "gap_closed": {"test": None, "shifted": None}}
    return {"verdict": nothing | told | {"established": entries}}


if __name__ == "__main__":
    main()
