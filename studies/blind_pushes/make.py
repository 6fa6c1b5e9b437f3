"""A blind clay world's table and its truth, sealed.

`python -m studies.blind_pushes.make --stratum one --seed 3 --out data/world`

Whoever diagnoses gets `table.parquet` alone; `truth.sha256` can be published before the verdict and checked after it.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import pyarrow as pa

from studies.blind.make import write_world
from studies.blind.strength import Strength
from studies.blind_pushes.collect import as_table, decoys, recorded_rows
from studies.blind_pushes.strength import find_strength, prepare_trial
from studies.blind_pushes.worlds import Outside, Sketch, Stratum, sketch_world


@dataclass(frozen=True)
class Truth:
    """What a blind world hides. One strength for each cause, or one for the outside effect."""

    stratum: Stratum
    seed: int
    tool: str
    causes: tuple[str, ...]
    outside: Outside | None
    wanted_q: tuple[float, ...]
    strengths: tuple[Strength, ...]
    misshaped: bool


def make_world(sketch: Sketch) -> tuple[pa.Table, Truth]:
    """Find the strengths of a sketch's effects, and record its world.

    Raises StrengthError where an effect cannot be as strong as it is wanted.
    """
    strengths: tuple[Strength, ...] = ()
    if sketch.effects:
        trial = prepare_trial(sketch)
        strengths = tuple(find_strength(trial, effect, q) for effect, q in zip(sketch.effects, sketch.q, strict=True))
    truth = Truth(
        sketch.stratum, sketch.seed, sketch.tool.name, sketch.causes, sketch.outside, sketch.q, strengths,
        sketch.misshaped,
    )  # fmt: skip
    return recorded(sketch, truth), truth


def recorded(sketch: Sketch, truth: Truth, times: float = 1.0) -> pa.Table:
    """The world's table, with its effects at `times` their strengths."""
    given = {effect: times * found.strength for effect, found in zip(sketch.effects, truth.strengths, strict=True)}
    rows = recorded_rows(sketch, sketch.with_strengths(given), sketch.seed)
    return as_table(rows, decoys(len(rows), sketch.seed))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.blind_pushes.make", description=__doc__)
    parser.add_argument("--stratum", required=True, choices=get_args(Stratum))
    parser.add_argument("--seed", required=True, type=int)
    parser.add_argument("--out", required=True, type=Path)
    parser.add_argument("--cause", help="default: drawn by the seed")
    parser.add_argument("--q", type=float, help="energy over the noise floor; default: drawn by the seed")
    given = parser.parse_args()
    sketch = sketch_world(given.stratum, given.seed, given.cause, given.q)
    table, truth = make_world(sketch)
    write_world(given.out, table, truth)
    print(f"{given.out}: {table.num_rows} rows of the {sketch.tool.name}, sealed.")


if __name__ == "__main__":
    main()
