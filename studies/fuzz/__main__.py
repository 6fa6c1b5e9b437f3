"""`python -m studies.fuzz --cases 10000 [--bundle models/bundle]`: prints a table; 1 where anything is found."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from studies.fuzz.run import Tally, fuzz


def main(arguments: argparse.Namespace) -> int:
    """Print what came of every reader, and what crashed or passed."""
    found = fuzz(arguments.cases, arguments.seed, arguments.bundle)
    total = Tally()
    print("| reader | cases | refused with a sentence | still sound | crashed | accepted | without a sentence |")
    print("|---|---|---|---|---|---|---|")
    for name, tally in found.items():
        total.add(tally)
        print(_row(name, tally))
    print(_row("all", total))
    for name, tally in found.items():
        for crash, count in tally.crashes.items():
            print(f"{name}: {count} × {crash}")
    return int(bool(total.crashes) or total.accepted > 0 or total.mute > 0)


def _row(name: str, tally: Tally) -> str:
    cells = (tally.cases, tally.refused, tally.sound, sum(tally.crashes.values()), tally.accepted, tally.mute)
    return f"| {name} | {' | '.join(map(str, cells))} |"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="studies.fuzz", description=__doc__)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--bundle", type=Path, help="folder of a bundle whose files are altered, too")
    sys.exit(main(parser.parse_args()))
