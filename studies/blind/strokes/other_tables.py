"""Other tables of a simulated world of strokes: out of distribution, with the proposed actions, with a doubled
effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from studies.blind.decoys import draw_decoys
from studies.blind.strokes.collect import as_table, record_world
from studies.blind.strokes.design import Command, View, randomised, view_of
from studies.blind.strokes.make import commands_of
from studies.blind.strokes.strength import CEILING, STRONGEST
from studies.blind.strokes.worlds import Sketch
from studies.blind.truth import StrengthError, Truth

FloatArray = NDArray[np.float64]

SHIFTED_SHEETS = (0, 2)
"""Sheets of the design that share twelve repeated actions."""
SHIFTED_REALISATION = 3  # of sheets, fills and noise; 0 is the table's, 1 and 2 measured the strengths


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
    return _recorded(
        sketch, truth, some, view=view, columns=draw_decoys(len(some), seed), realisation=SHIFTED_REALISATION
    )


def with_actions(sketch: Sketch, truth: Truth, table: pa.Table, actions: pa.Table) -> pa.Table:
    """The world's recording, continued on a new sheet by proposed actions (the columns of `next_actions.parquet`).

    The wait before an action is the wait before the previous stroke's photograph.
    """
    view = view_of(sketch.tool, fine=False)
    commands = commands_of(sketch, view)
    more = commands_from(actions, sketch, view, commands[-1].sheet + 1, 1 + max(c.action_id for c in commands))
    late = draw_decoys(len(more), sketch.seed + 1)
    names = [name for name in table.column_names if name in late]
    columns = {name: np.concatenate([table[name].to_numpy(), late[name]]) for name in names}
    return _recorded(sketch, truth, [*commands, *more], view=view, columns=columns)


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


def with_doubled(sketch: Sketch, truth: Truth, table: pa.Table) -> pa.Table:
    """The same world with its one cause at twice the strength.

    Raises StrengthError where that is above the max physical strength.
    """
    (cause,), (found,) = sketch.causes, truth.strengths
    strength = 2 * found.strength
    if strength > CEILING.get(cause, STRONGEST):
        raise StrengthError(f"{cause} cannot be doubled from {found.strength:.3g}; hide it in another world.")
    view = view_of(sketch.tool, fine=False)
    doubled = replace(truth, strengths=(replace(found, strength=strength),))
    columns = draw_decoys(table.num_rows, sketch.seed)
    return _recorded(sketch, doubled, commands_of(sketch, view), view=view, columns=columns)


def _recorded(
    sketch: Sketch,
    truth: Truth,
    commands: list[Command],
    *,
    view: View,
    columns: dict[str, FloatArray],
    realisation: int = 0,
) -> pa.Table:
    world = sketch.with_strengths(tuple(s.strength for s in truth.strengths))
    recording = record_world(
        world,
        sketch.seed,
        sketch.tool,
        palette_srgb=sketch.palette_srgb,
        commands=commands,
        view=view,
        realisation=realisation,
    )
    return as_table(recording, columns)
