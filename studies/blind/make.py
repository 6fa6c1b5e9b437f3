"""Make one blind world: `python -m studies.blind.make --stratum one --cause bristle_lag --q 0.2 --seed 3 --out DIR`.

DIR gets `table.parquet` (contract `strokes`), `truth.json`, and `truth.sha256`, which seals the truth: it can be
published before the verdict and checked after it.
"""

import argparse
import hashlib
import io
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import get_args

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pentimento.contracts.atomic import atomic_write
from studies.blind.collect import as_table, record_world
from studies.blind.decoys import draw_decoys
from studies.blind.design import Command, View, randomised, raster, view_of
from studies.blind.strength import Strength, disturbances, find_strength, prepare_trial
from studies.blind.worlds import Outside, Sketch, Stratum, ToolName, sketch_world

FloatArray = NDArray[np.float64]


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


def make_world(sketch: Sketch, fine: bool = False) -> tuple[pa.Table, Truth]:
    """Find the strengths of a sketch's effects, and record its world.

    Raises StrengthError where an effect cannot be as strong as it is wanted.
    """
    view = view_of(sketch.tool, fine)
    commands = commands_of(sketch, view)
    lively = sketch.outside.column if sketch.outside is not None else None
    columns = draw_decoys(len(commands), sketch.seed, lively)
    column = None if sketch.outside is None else _driver(sketch, columns, len(commands))
    strengths: tuple[Strength, ...] = ()
    if sketch.q:
        trial = prepare_trial(sketch, commands, view, column)
        effects: tuple[str | None, ...] = sketch.causes or (None,)
        strengths = tuple(find_strength(trial, cause, q) for cause, q in zip(effects, sketch.q, strict=True))
    given = [] if column is None else disturbances(_outside(sketch), column, strengths[0].strength)
    world = sketch.with_strengths(tuple(s.strength for s in strengths))
    recording = record_world(world, sketch.seed, sketch.tool, sketch.palette_srgb, commands, view, given)
    truth = Truth(
        sketch.stratum, sketch.seed, sketch.tool.name, sketch.causes, sketch.outside, sketch.q, strengths,
        sketch.misshaped,
    )  # fmt: skip
    return as_table(recording, columns), truth


def commands_of(sketch: Sketch, view: View) -> list[Command]:
    """The design of a world's stratum."""
    make = raster if sketch.stratum == "raster" else randomised
    return make(sketch.tool, sketch.world.paper.size_m, sketch.palette_srgb, view, sketch.seed)


def write_world(folder: Path, table: pa.Table, truth: Truth) -> None:
    """Write `table.parquet`, `truth.json` and its seal."""
    buffer = io.BytesIO()
    pq.write_table(table, buffer, compression="zstd")
    atomic_write(folder / "table.parquet", buffer.getvalue())
    text = (json.dumps(asdict(truth), indent=1) + "\n").encode()
    atomic_write(folder / "truth.sha256", (hashlib.sha256(text).hexdigest() + "\n").encode())
    atomic_write(folder / "truth.json", text)


def _outside(sketch: Sketch) -> Outside:
    assert sketch.outside is not None
    return sketch.outside


def _driver(sketch: Sketch, columns: dict[str, FloatArray], rows: int) -> FloatArray:
    """The standardised column [rows] that an outside effect follows."""
    name = _outside(sketch).column
    if name != "hidden":
        return (columns[name] - columns[name].mean()) / columns[name].std()
    rng = np.random.default_rng([sketch.seed, 2])
    wave = np.sin(2 * np.pi * np.arange(rows) / rng.uniform(9, 17) + rng.uniform(0, 2 * np.pi))
    return wave / wave.std()


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.blind.make", description=__doc__)
    parser.add_argument("--stratum", required=True, choices=get_args(Stratum))
    parser.add_argument("--seed", required=True, type=int)
    parser.add_argument("--out", required=True, type=Path)
    parser.add_argument("--cause", help="default: drawn by the seed")
    parser.add_argument("--tool", choices=get_args(ToolName), help="default: drawn by the seed")
    parser.add_argument("--q", type=float, help="energy over the noise floor; default: drawn by the seed")
    parser.add_argument("--fine", action="store_true", help="windows of 128 × 96 px instead of 64 × 48")
    given = parser.parse_args()
    sketch = sketch_world(given.stratum, given.seed, given.cause, given.tool, given.q)
    table, truth = make_world(sketch, given.fine)
    write_world(given.out, table, truth)
    print(f"{given.out}: {table.num_rows} rows of the {sketch.tool.name}, sealed.")


if __name__ == "__main__":
    main()
