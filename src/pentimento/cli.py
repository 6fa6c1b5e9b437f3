"""The command `pentimento`. Each subcommand imports what it needs when it runs."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from pentimento.contracts.errors import PentimentoError


def main(arguments: list[str] | None = None) -> int:
    """Run a subcommand; 0, or 1 with a sentence on stderr."""
    parser = argparse.ArgumentParser(prog="pentimento", description="Robots that learn their own brushes.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    diagnose = commands.add_parser(
        "diagnose", help="what a simulation gets wrong about measured strokes, and why (needs pentimento[train])"
    )
    diagnose.add_argument("rows", type=Path, help="a table in the strokes contract: a file, or a folder of shards")
    diagnose.add_argument("--out", required=True, type=Path, help="folder for verdict.json")
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
    from pentimento.contracts.tables import read_table
    from pentimento.gap.diagnose import diagnose
    from pentimento.gap.measured import load_measured
    from pentimento.gap.verdict import verdict
    from pentimento.stroke_dynamics.mechanisms import VOCABULARY

    checked = read_table(arguments.rows, CONTRACT)
    if checked.quarantined:
        print(f"{len(checked.quarantined)} rows break the contract and are left out.", file=sys.stderr)
    measured = load_measured(checked.table)
    found = diagnose(measured, VOCABULARY, arguments.seed, lambda line: print(line, file=sys.stderr))
    arguments.out.mkdir(parents=True, exist_ok=True)
    result = verdict(found, len(measured), len(set(measured.action.tolist())))
    (arguments.out / "verdict.json").write_text(json.dumps(result, indent=1) + "\n")
    print(result["sentence"])


if __name__ == "__main__":
    sys.exit(main())
