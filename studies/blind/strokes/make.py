"""Make a simulated world of strokes: find the strengths of its effects, and record its table."""

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from studies.blind.decoys import draw_decoys
from studies.blind.series import Stratum
from studies.blind.strokes.collect import as_table, record_world
from studies.blind.strokes.design import Command, View, randomised, raster, view_of
from studies.blind.strokes.strength import disturbances, find_strength, prepare_trial
from studies.blind.strokes.worlds import Outside, Sketch, sketch_world
from studies.blind.truth import Strength, Truth

FloatArray = NDArray[np.float64]


def sketch(stratum: Stratum, seed: int, cause: str | None, q: float | None) -> Sketch:
    """Draw a world whose tool follows from its seed."""
    return sketch_world(stratum, seed, cause, q=q)


def make_world(sketch: Sketch, fine: bool = False) -> tuple[pa.Table, Truth]:
    """Return the table of a sketch's world and what the world hides.

    Raises StrengthError where no strength gives an effect its wanted energy.
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
    recording = record_world(
        world,
        sketch.seed,
        sketch.tool,
        palette_srgb=sketch.palette_srgb,
        commands=commands,
        view=view,
        disturbances=given,
    )
    truth = Truth(
        sketch.stratum, sketch.seed, sketch.tool.name, sketch.causes, sketch.outside, sketch.q, strengths,
        sketch.misshaped,
    )  # fmt: skip
    return as_table(recording, columns), truth


def commands_of(sketch: Sketch, view: View) -> list[Command]:
    """The design of a world's stratum."""
    make = raster if sketch.stratum == "raster" else randomised
    return make(sketch.tool, sketch.world.paper.size_m, sketch.palette_srgb, view, sketch.seed)


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
