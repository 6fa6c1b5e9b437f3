"""The two kinds of the benchmark: what differs between worlds of strokes and worlds of pushes.

`python -m studies.blind.kinds --kind strokes --stratum one --seed 3 --out DIR` makes one world: DIR gets
`table.parquet`, `truth.json` and `truth.sha256`, the truth's hash, which can be published before the verdict.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import pyarrow as pa

from pentimento.contracts.errors import ContractError
from studies.blind import pushes, series, strokes
from studies.blind.pushes import make as push_worlds
from studies.blind.pushes.worlds import GEOMETRIC as GEOMETRIC_OF_PUSHES
from studies.blind.strokes import make as stroke_worlds
from studies.blind.strokes import other_tables
from studies.blind.strokes.worlds import GEOMETRIC as GEOMETRIC_OF_STROKES
from studies.blind.truth import StrengthError, Truth, write_world

KindName = Literal["strokes", "pushes"]


@dataclass(frozen=True)
class Kind:
    """One kind of world. `sketch` is the kind's own `Sketch`."""

    name: KindName
    series: tuple[series.Series, ...]
    seed_prefix: str
    """Before the series' name where seeds are drawn."""
    sketch: Callable[[series.Stratum, int, str | None, float | None], Any]
    """Draws a world by stratum and seed; cause and q where they are given."""
    make: Callable[[Any], tuple[pa.Table, Truth]]
    doubled: Callable[[Any, Truth, pa.Table], pa.Table]
    """The same world with its one cause at twice the strength."""
    cannot_be_made: tuple[type[Exception], ...]
    """Errors for which a world is drawn again."""
    verdict_module: str
    """Run in a process of its own, as `python -m … table.parquet verdict.json`."""
    geometric: frozenset[str]
    """Causes with the bar of geometric ones; the others are material."""
    seconds: float
    """Bar on the processor time of a verdict."""
    single_cause_series: tuple[str, ...]
    """Series that the page's table of causes counts."""
    title: str
    page: Path
    """In docs/."""
    introduction: str


def kind_of(name: KindName) -> Kind:
    """The kind with this name."""
    match name:
        case "strokes":
            return Kind(
                name="strokes",
                series=series.STROKES,
                seed_prefix="",
                sketch=stroke_worlds.sketch,
                make=stroke_worlds.make_world,
                doubled=other_tables.with_doubled,
                cannot_be_made=(StrengthError,),
                verdict_module="studies.blind.strokes.verdict_of",
                geometric=frozenset(GEOMETRIC_OF_STROKES),
                seconds=10.0,
                single_cause_series=("one cause", "one faint cause"),
                title="Blind benchmark of the diagnosis: strokes",
                page=Path("docs/blind_tests.md"),
                introduction=strokes.INTRODUCTION,
            )
        case "pushes":
            return Kind(
                name="pushes",
                series=series.PUSHES,
                seed_prefix="pushes, ",
                sketch=push_worlds.sketch_world,
                make=push_worlds.make_world,
                doubled=push_worlds.with_doubled,
                cannot_be_made=(StrengthError, ContractError),  # the latter: a hole in the scan where a push should go
                verdict_module="studies.blind.pushes.verdict_of",
                geometric=frozenset(GEOMETRIC_OF_PUSHES),
                seconds=60.0,
                single_cause_series=("one cause", "shuffled", "doubled", "deleted"),
                title="Blind benchmark of the diagnosis: pushes",
                page=Path("docs/blind_pushes.md"),
                introduction=pushes.INTRODUCTION,
            )


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.blind.kinds", description=__doc__)
    parser.add_argument("--kind", required=True, choices=get_args(KindName))
    parser.add_argument("--stratum", required=True, choices=get_args(series.Stratum))
    parser.add_argument("--seed", required=True, type=int)
    parser.add_argument("--out", required=True, type=Path)
    parser.add_argument("--cause", help="default: drawn by the seed")
    parser.add_argument("--q", type=float, help="energy over the noise floor; default: drawn by the seed")
    args = parser.parse_args()
    kind = kind_of(args.kind)
    table, truth = kind.make(kind.sketch(args.stratum, args.seed, args.cause, args.q))
    write_world(args.out, table, truth)
    print(f"{args.out}: {table.num_rows} rows of the {truth.tool}.")


if __name__ == "__main__":
    main()
