"""Make a simulated world of pushes: find the strengths of its effects, and record its table."""

from __future__ import annotations

import pyarrow as pa

from studies.blind.pushes.collect import as_table, decoys, recorded_rows
from studies.blind.pushes.strength import find_strength, prepare_trial
from studies.blind.pushes.worlds import Sketch
from studies.blind.pushes.worlds import sketch_world as sketch_world
from studies.blind.truth import Strength, Truth


def make_world(sketch: Sketch) -> tuple[pa.Table, Truth]:
    """Return the table of a sketch's world and what the world hides.

    Raises StrengthError where no strength gives an effect its wanted energy.
    """
    strengths: tuple[Strength, ...] = ()
    if sketch.effects:
        trial = prepare_trial(sketch)
        strengths = tuple(find_strength(trial, effect, q) for effect, q in zip(sketch.effects, sketch.q, strict=True))
    truth = Truth(
        sketch.stratum, sketch.seed, sketch.tool.name, sketch.causes, sketch.outside, sketch.q, strengths,
        sketch.misshaped,
    )  # fmt: skip
    return _recorded(sketch, truth, 1.0), truth


def with_doubled(sketch: Sketch, truth: Truth, table: pa.Table) -> pa.Table:
    """The same world with its effects at twice their strengths."""
    return _recorded(sketch, truth, 2.0)


def _recorded(sketch: Sketch, truth: Truth, factor: float) -> pa.Table:
    given = {effect: factor * found.strength for effect, found in zip(sketch.effects, truth.strengths, strict=True)}
    rows = recorded_rows(sketch, sketch.with_strengths(given), sketch.seed)
    return as_table(rows, decoys(len(rows), sketch.seed))
