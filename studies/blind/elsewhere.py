"""Further tables of a blind world: of a shifted context, with the proposed actions, and with a changed truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from studies.blind.collect import as_table, record_world
from studies.blind.decoys import draw_decoys
from studies.blind.design import Command, View, randomised, view_of
from studies.blind.make import Truth, commands_of
from studies.blind.strength import CEILING, STRONGEST, StrengthError
from studies.blind.worlds import Sketch

FloatArray = NDArray[np.float64]

SHIFTED_SHEETS = (0, 2)
"""Which repeat twelve actions once."""
SHIFTED_REALISATION = 3  # of sheets, fills and noise: none that a strength was measured in

COLUMNS: dict[str, tuple[str, ...]] = {
    "ink_depletion": ("since_reload", "reload_id", "ink_since_reload_m"),
    "tool_wear": ("order", "t_before_s", "t_start_s", "t_after_s", "tool_age_m", "surface_id"),
    "drying_shift": ("order", "t_before_s", "t_start_s", "t_after_s", "tool_age_m", "surface_id"),
    "wet_mixing": ("wet_age_s",),
}
"""Columns that tell a cause's covariate, one as well as the other."""


def shifted_table(sketch: Sketch, truth: Truth) -> pa.Table:
    """56 strokes of the same world in another session: pressed in the deeper half of the tool's range, and fast."""
    tool = sketch.tool
    light, deep = tool.press_range_m
    slow, fast = tool.speed_range_m_s
    pressed = replace(
        tool, press_range_m=((light + deep) / 2, deep), speed_range_m_s=(float(np.sqrt(slow * fast)), fast)
    )
    view = view_of(tool, fine=False)
    seed = sketch.seed + 1
    design = randomised(pressed, sketch.world.paper.size_m, sketch.palette_srgb, view, seed)
    some = [command for command in design if command.sheet in SHIFTED_SHEETS]
    return _recorded(sketch, truth, some, view, draw_decoys(len(some), seed), SHIFTED_REALISATION)


def with_actions(sketch: Sketch, truth: Truth, table: pa.Table, actions: pa.Table) -> pa.Table:
    """The world's recording, gone on with on a new sheet by proposed actions (the columns of `next_actions.parquet`).

    What is waited before an action is waited before the photograph of the stroke before it.
    """
    view = view_of(sketch.tool, fine=False)
    commands = commands_of(sketch, view)
    more = commands_from(actions, sketch, view, commands[-1].sheet + 1, 1 + max(c.action_id for c in commands))
    late = draw_decoys(len(more), sketch.seed + 1)
    names = [name for name in table.column_names if name in late]
    columns = {name: np.concatenate([table[name].to_numpy(), late[name]]) for name in names}
    return _recorded(sketch, truth, [*commands, *more], view, columns)


def commands_from(actions: pa.Table, sketch: Sketch, view: View, sheet: int, first_action: int) -> list[Command]:
    """Proposed actions as commands, in their order."""
    rows = actions.to_pylist()
    waits = [row["wait_s"] for row in rows[1:]] + [0.0]
    image_rows = round(sketch.world.paper.size_m[1] * view.pixels_per_m)
    made = []
    for number, (row, wait_s) in enumerate(zip(rows, waits, strict=True)):
        x_min, y_min, x_max, y_max = np.array(row["window_m"]) * view.pixels_per_m
        size = round(x_max - x_min), round(y_max - y_min)
        window_px = round(x_min), image_rows - round(y_min) - size[1], *size
        distance = np.linalg.norm(sketch.palette_srgb - np.array(row["color_srgb"]), axis=1)
        red, green, blue = (float(c) for c in sketch.palette_srgb[int(distance.argmin())])
        dip, wait_s = row["reload"] and sketch.tool.dips, max(wait_s, 1.0)
        path = np.array(row["path"])
        made.append(Command(first_action + number, sheet, path, window_px, (red, green, blue), dip, wait_s))
    return made


def with_shuffled(table: pa.Table, cause: str, seed: int) -> pa.Table:
    """The table with the covariate of a cause (one of `COLUMNS`) dealt out to the rows anew."""
    order = np.random.default_rng([seed, 41]).permutation(table.num_rows)
    for name in COLUMNS[cause]:
        if name in table.column_names:
            at = table.column_names.index(name)
            table = table.set_column(at, table.schema.field(name), table[name].take(order))
    return table


def with_doubled(sketch: Sketch, truth: Truth, table: pa.Table) -> pa.Table:
    """The same world with its one cause at twice the strength.

    Raises StrengthError where that is more than physics allows.
    """
    (cause,), (found,) = sketch.causes, truth.strengths
    strength = 2 * found.strength
    if strength > CEILING.get(cause, STRONGEST):
        raise StrengthError(f"{cause} cannot be doubled from {found.strength:.3g}; hide it in another world.")
    view = view_of(sketch.tool, fine=False)
    doubled = replace(truth, strengths=(replace(found, strength=strength),))
    columns = draw_decoys(table.num_rows, sketch.seed)
    return _recorded(sketch, doubled, commands_of(sketch, view), view, columns)


def _recorded(
    sketch: Sketch,
    truth: Truth,
    commands: list[Command],
    view: View,
    columns: dict[str, FloatArray],
    realisation: int = 0,
) -> pa.Table:
    world = sketch.with_strengths(tuple(s.strength for s in truth.strengths))
    recording = record_world(
        world, sketch.seed, sketch.tool, sketch.palette_srgb, commands, view, realisation=realisation
    )
    return as_table(recording, columns)
