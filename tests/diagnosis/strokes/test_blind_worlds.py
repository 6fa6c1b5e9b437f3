"""Three small worlds of the virtual studio: hidden causes are named. `make studies` has the large benchmark.

The strengths give q = .4 in the whole design (`studies.blind.strokes.strength.find_strength`). Finding the strengths
takes most of a world's time, so they are listed here.
"""

from dataclasses import dataclass

import pytest

from studies.blind.decoys import draw_decoys
from studies.blind.strokes.collect import as_table, record_world
from studies.blind.strokes.design import view_of
from studies.blind.strokes.make import commands_of
from studies.blind.strokes.strength import disturbances
from studies.blind.strokes.verdict_of import verdict_on
from studies.blind.strokes.worlds import Stratum, ToolName, sketch_world

SHEETS = 3  # of six: 84 strokes of 72 actions


@dataclass(frozen=True)
class Hidden:
    """A world: drawn by its seed, with its causes (or an outside effect) at these strengths."""

    seed: int
    stratum: Stratum
    tool: ToolName
    strengths: tuple[float, ...] = ()
    cause: str | None = None


WORLDS = (
    Hidden(2, "one", "round_brush", (0.311,), "ink_depletion"),
    Hidden(3, "one", "marker", (0.182,), "path_scale"),
    Hidden(9, "outside", "round_brush", (0.622,)),
)


def hidden_and_named(world: Hidden) -> tuple[set[str], set[str]]:
    """The causes that a world hides, and those that the verdict on its table establishes."""
    sketch = sketch_world(world.stratum, world.seed, world.cause, world.tool)
    view = view_of(sketch.tool, fine=False)
    commands = [command for command in commands_of(sketch, view) if command.sheet < SHEETS]
    columns = draw_decoys(len(commands), world.seed, sketch.outside.column if sketch.outside else None)
    given = []
    if sketch.outside is not None:
        column = columns[sketch.outside.column]
        given = disturbances(sketch.outside, (column - column.mean()) / column.std(), world.strengths[0])
    effective = sketch.with_strengths(world.strengths if sketch.causes else ())
    recording = record_world(
        effective,
        world.seed,
        sketch.tool,
        palette_srgb=sketch.palette_srgb,
        commands=commands,
        view=view,
        disturbances=given,
    )
    verdict, _, _ = verdict_on(as_table(recording, columns), seed=0)
    return set(sketch.causes), {entry["cause"] for entry in verdict["established"]}


@pytest.mark.timeout(600)
def test_names_simulated_worlds_exactly() -> None:
    found = [hidden_and_named(world) for world in WORLDS]
    assert all(hidden == named for hidden, named in found), found
