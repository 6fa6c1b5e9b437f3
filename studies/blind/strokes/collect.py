"""Executes the design of a simulated world and records it in the `strokes` contract.

Guard, `execute_stroke`, memory, rectification and `record_stroke` are those of the pipeline's collection. The camera
reads out a part of its frame only, so that a world takes seconds.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.calibration.observe import calibrate_camera, window_in_camera
from pentimento.collection.collect import record_stroke, stroke_views
from pentimento.contracts.covariates import drawn_length_m, fresh_memory, new_sheet
from pentimento.contracts.markers import markers_around
from pentimento.contracts.plan import PlannedStroke
from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.strokes import CONTRACT
from pentimento.control.execute import Session, execute_stroke
from pentimento.control.guard import GuardedRobot
from pentimento.control.safety import envelope_for
from pentimento.robots.tools import Tool
from pentimento.robots.virtual import VirtualRobot
from pentimento.studio.strokes.world import World
from studies.blind.strokes.design import Command, View
from studies.blind.strokes.paint_context import Disturbance, PaintContext

MEASURED = {"measured_path", "force_n"}
"""Columns that the robot measures."""
SKIPPED_S = 12.0  # duration of a skipped stroke


@dataclass(frozen=True, eq=False)
class Recording:
    """Rows of the contract in order, and their images as arrays.

    before, after: lists of uint8 sRGB [H, W, 3].
    """

    rows: list[dict[str, Any]]
    before: list[NDArray[np.uint8]]
    after: list[NDArray[np.uint8]]


def record_world(
    world: World,
    seed: int,
    tool: Tool,
    *,
    palette_srgb: NDArray[np.float64],
    commands: Sequence[Command],
    view: View,
    disturbances: Sequence[Disturbance] = (),
    sheets: Collection[int] | None = None,
    realisation: int = 0,
) -> Recording:
    """Execute commands in a studio of `world` under `seed`.

    Args:
        disturbances: one for each command, or none at all.
        sheets: only these are painted; tool age and time advance as if the others were painted, too.
        realisation: of everything that differs between repeats (see `PaintContext`).
    """
    paint_context = PaintContext(world, seed, realisation)
    robot = GuardedRobot(VirtualRobot(paint_context), envelope_for(tool, paint_context.canvas_size_m))
    robot.change_tool(tool)
    robot.load_palette(palette_srgb)
    calibration = calibrate_camera(robot.photo(), markers_around(paint_context.canvas_size_m))
    session = Session("session_0", robot.clock_s)
    memory = fresh_memory(paint_context.canvas_size_m, tool.nominal_width_m)
    recording = Recording([], [], [])
    sheet = commands[0].sheet
    for order, command in enumerate(commands):
        if sheets is not None and command.sheet not in sheets:
            paint_context.skip(drawn_length_m(command.path), SKIPPED_S + command.wait_s)
            continue
        if command.sheet != sheet:
            sheet = command.sheet
            robot.new_sheet()
            memory = new_sheet(memory)
        if disturbances:
            paint_context.disturb(disturbances[order])
        window_m = _window_m(command, view, paint_context.canvas_size_m)
        paint_context.read_out(window_in_camera(calibration, window_m))
        photo_before = robot.photo()
        planned = PlannedStroke(command.path, np.array(command.color_srgb), command.dip)
        memory, executed = execute_stroke(
            robot, tool, planned, palette_srgb=palette_srgb, memory=memory, session=session
        )
        robot.wait(command.wait_s)
        photo_after = robot.photo()
        views = stroke_views(photo_before, photo_after, calibration, window_m=window_m, pixels_per_m=view.pixels_per_m)
        row = record_stroke(session, executed, views, order=order, action_id=command.action_id, tool=tool)
        row |= {"surface_id": f"sheet_{sheet}", "tool_id": f"{tool.name}_0", "camera_id": "camera_0"}
        recording.rows.append(row)
        recording.before.append(views.before)
        recording.after.append(views.after)
    return recording


def as_table(recording: Recording, columns: dict[str, NDArray[np.float64]]) -> pa.Table:
    """Rows as a table of the contract with additional columns float64[rows].

    Without what the robot measured: the benchmark is of what photographs alone tell.
    """
    schema = arrow_schema(CONTRACT, include_optional=set(recording.rows[0]) - MEASURED)
    table = pa.Table.from_pylist(recording.rows, schema=schema)
    for name, values in columns.items():
        table = table.append_column(name, pa.array(values.astype(np.float32)))
    return table


def _window_m(command: Command, view: View, canvas_size_m: tuple[float, float]) -> NDArray[np.float64]:
    column, row, width, height = command.window_px
    image_rows = round(canvas_size_m[1] * view.pixels_per_m)
    edges = [column, image_rows - row - height, column + width, image_rows - row]
    return np.array(edges, dtype=np.float64) / view.pixels_per_m
