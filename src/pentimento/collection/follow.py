"""Execution of proposed strokes: rows that continue a table of strokes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.calibration.observe import calibrate_camera
from pentimento.collection.collect import record_stroke, stroke_views
from pentimento.contracts.covariates import drawn_length_m, fresh_memory
from pentimento.contracts.errors import ContractError
from pentimento.contracts.frames import image_shape, pixels_per_m, snap_window
from pentimento.contracts.images import decode_png
from pentimento.contracts.markers import markers_around
from pentimento.contracts.plan import PlannedStroke
from pentimento.control.execute import Session, execute_stroke
from pentimento.robots.driver import Robot
from pentimento.robots.motion import timed_path
from pentimento.robots.tools import Tool

FloatArray = NDArray[np.float64]

_SETTLE_S = 1.0
"""Min time between a stroke and its photograph, as in a collection."""


def tool_of(table: pa.Table) -> str:
    """Name of the tool of a table's strokes.

    Raises:
        ContractError: there are several, or the strokes' places on the canvas are unknown.
    """
    names = sorted(set(table["tool"].to_pylist()))
    if not names:
        raise ContractError("The strokes table has no rows: a robot cannot know which tool to go on with.")
    if len(names) != 1:
        raise ContractError(
            f"The strokes are of the tools {', '.join(names)}; a robot goes on with a table of one tool."
        )
    if "frame" in table.schema.names and "stroke" in table["frame"].to_pylist():
        raise ContractError(
            "The strokes are recorded in their own frame: where they lay on the canvas is unknown, so that a robot "
            "cannot go on with them. Record them with `frame` canvas."
        )
    return str(names[0])


def further_strokes(robot: Robot, tool: Tool, session: str) -> Callable[[pa.Table, pa.Table, int], pa.Table]:
    """A function of proposed actions, the table so far and the number of the round that executes the actions.

    Args:
        robot: behind its guard.
        tool: that made the recorded strokes.
        session: name of the new sessions, before the number of the round.
    """
    drawn_m = 0.0

    def execute(actions: pa.Table, recorded: pa.Table, number: int) -> pa.Table:
        nonlocal drawn_m
        rows = follow(robot, tool, actions, recorded=recorded, session=f"{session}-round-{number}", tool_age_m=drawn_m)
        drawn_m += sum(drawn_length_m(np.array(path)) for path in rows["path"].to_pylist())
        return rows

    return execute


def follow(
    robot: Robot, tool: Tool, actions: pa.Table, *, recorded: pa.Table, session: str, tool_age_m: float
) -> pa.Table:
    """Execute proposed actions (the columns of ``next_actions.parquet``) in their order on a new sheet.

    Returns a session of rows with the columns of ``recorded``.

    The wait before an action comes before the photograph of the previous stroke. Where the recording has no times,
    strokes have the tool's default speed. Recorded columns that the robot does not measure are null.

    Args:
        robot: behind its guard.
        tool: that made the recorded strokes.
        actions: at least one.
        recorded: the table so far; action numbers go on from it.
        session: name of the new one.
        tool_age_m: length that the robot's tool has drawn before.

    Raises:
        ContractError: a colour that is not the tool's own, or no markers in sight.
        PentimentoError: what the robot or its guard refuses.
    """
    palette = _palette(tool, actions)
    robot.change_tool(tool)
    robot.new_sheet()
    robot.load_palette(palette)
    calibration = calibrate_camera(robot.photo(), markers_around(robot.canvas_size_m))
    scale = _pixels_per_m(recorded)
    canvas = np.array([0.0, 0.0, *robot.canvas_size_m])
    shape = image_shape(canvas, scale)
    here = Session(session, robot.clock_s)
    memory = fresh_memory(robot.canvas_size_m, tool.nominal_width_m, tool_age_m)
    first = 1 + max(recorded["action_id"].to_pylist())
    todo = actions.to_pylist()
    rows: list[dict[str, Any]] = []
    for order, action in enumerate(todo):
        window = snap_window(np.array(action["window_m"]), canvas, shape)
        before = robot.photo()
        memory, made = execute_stroke(
            robot, tool, _planned(action, tool, palette), palette_srgb=palette, memory=memory, session=here
        )
        robot.wait(max(todo[order + 1]["wait_s"] if order + 1 < len(todo) else 0.0, _SETTLE_S))
        after = robot.photo()
        views = stroke_views(before, after, calibration, window_m=window, pixels_per_m=scale)
        row = record_stroke(here, made, views, order=order, action_id=first + order, tool=tool)
        rows.append(row | {"surface_id": session})
    names = recorded.schema.names
    return pa.Table.from_pylist(
        [{name: row.get(name) for name in names} for row in rows], schema=recorded.schema.remove_metadata()
    )


def _planned(action: dict[str, Any], tool: Tool, palette: FloatArray) -> PlannedStroke:
    path = np.array(action["path"], dtype=np.float64)
    if not np.isfinite(path[:, 0]).all():
        path = timed_path(path[:, 1:], tool.speed_m_s)
    nearest = np.linalg.norm(palette - np.array(action["color_srgb"]), axis=1).argmin()
    return PlannedStroke(path, palette[nearest], bool(action["reload"]) and tool.dips)


def _palette(tool: Tool, actions: pa.Table) -> FloatArray:
    """[K, 3]: the tool's own ink, or every colour that the actions ask for."""
    asked = np.unique(np.array(actions["color_srgb"].to_pylist(), dtype=np.float64).round(4), axis=0)
    if tool.color_srgb is None:
        return asked
    own = np.array([tool.color_srgb])
    if np.abs(asked - own).max() > 0.5 / 255:
        raise ContractError(
            f"The strokes to be made are of the colours {asked.tolist()}, and the {tool.name} has ink of "
            f"{own[0].tolist()}: put a pen of that colour into its tool file."
        )
    return own


def _pixels_per_m(recorded: pa.Table) -> float:
    """Resolution of the recording's photographs, for the new ones."""
    row = recorded.slice(0, 1).to_pylist()[0]
    return pixels_per_m(decode_png(row["before"]["bytes"]).shape, row["window_m"])
