"""Score of anybody's verdicts: `python -m studies.blind.score WORLDS VERDICTS` (docs/benchmark_diagnosis.md).

VERDICTS/<number>.json is a `verdict.json` of `pentimento diagnose` on WORLDS/<number>/table.parquet, or has its keys
`established` and `unexplained`.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from studies.blind.binomial import interval
from studies.blind.kinds import kind_of
from studies.blind.score_card import rows


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.blind.score", description=__doc__)
    parser.add_argument("worlds", type=Path)
    parser.add_argument("verdicts", type=Path)
    given = parser.parse_args()
    print(score(given.worlds, given.verdicts))


def score(worlds: Path, verdicts: Path) -> str:
    """The rows of the score card, one a line."""
    lines, kinds = [], set()
    for folder in sorted(path.parent for path in worlds.glob("*/truth.json")):
        about = json.loads((folder / "series.json").read_text())
        kinds.add(about["kind"])
        line = {
            "series": about["series"],
            "index": len(lines),
            "truth": json.loads((folder / "truth.json").read_text()),
        }
        lines.append(line | _verdict(verdicts / f"{folder.name}.json"))
    if len(kinds) != 1:
        sys.exit(f"{worlds} holds worlds of {len(kinds)} kinds, not of one: make them with `make`.")
    found = []
    for row in rows(kind_of(kinds.pop()), lines):
        low, high = interval(row.hits, row.of)
        found.append(f"{row.what}: {row.hits} of {row.of} ({low:.0%} to {high:.0%})")
    return "\n".join(found)


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
