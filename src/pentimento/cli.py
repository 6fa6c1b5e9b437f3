"""The command `pentimento`. Each subcommand imports what it needs when it runs."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from pentimento.contracts.errors import PentimentoError

_KINDS = ("strokes",)


def main(arguments: list[str] | None = None) -> int:
    """Run a subcommand; 0, or 1 with a sentence on stderr."""
    parser = argparse.ArgumentParser(prog="pentimento", description="Robots that learn their own brushes.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    diagnose = commands.add_parser(
        "diagnose", help="what a simulation gets wrong about measured strokes, and why (needs pentimento[train])"
    )
    diagnose.add_argument("rows", type=Path, help="a table in the strokes contract: a file, or a folder of shards")
    diagnose.add_argument("--out", required=True, type=Path, help="folder for verdict.json, report.html and more")
    diagnose.add_argument("--kind", choices=_KINDS, default="strokes", help="what the rows are")
    diagnose.add_argument(
        "--test", type=Path, help="an outside table, on which the share of the gap that is closed is measured, too"
    )
    diagnose.add_argument("--seed", type=int, default=0, help="of splits and bootstraps")
    diagnose.set_defaults(run=_diagnose)
    chosen = parser.parse_args(arguments)
    try:
        chosen.run(chosen)
    except (PentimentoError, OSError) as error:
        print(f"pentimento: {error}", file=sys.stderr)
        return 1
    return 0


def _diagnose(arguments: argparse.Namespace) -> None:
    from pentimento.contracts.strokes import CONTRACT
    from pentimento.contracts.tables import CheckedTable, read_table
    from pentimento.gap.write import write_diagnosis

    def left_out(checked: CheckedTable) -> str | None:
        """What the contract's check left out, as a sentence."""
        if not checked.quarantined:
            return None
        reasons = "; ".join(f"row {bad.row}: {bad.reason}" for bad in checked.quarantined[:8])
        return f"{len(checked.quarantined)} rows break the contract and are left out ({reasons})."

    checked = read_table(arguments.rows, CONTRACT)
    outside = None if arguments.test is None else read_table(arguments.test, CONTRACT).table
    write_diagnosis(checked.table, arguments.out, arguments.seed, _progress, outside, left_out(checked))
    print(json.loads((arguments.out / "verdict.json").read_text())["sentence"])
    print(f"The report is {arguments.out / 'report.html'}.")


def _progress(line: str) -> None:
    """For a person at a terminal; a log needs the verdict alone."""
    if sys.stderr.isatty():
        print(line, file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
