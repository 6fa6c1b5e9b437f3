"""Self-generated strokes: the robot marks its own paper by design and photographs every mark (thesis 4.3.2)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.calibration.observe import calibrate_camera, rectify
from pentimento.collection.design import CollectionConfig, design_collection
from pentimento.collection.record import record_stroke
from pentimento.contracts.covariates import fresh_memory, new_sheet
from pentimento.contracts.frames import image_shape, snap_window, window_around
from pentimento.contracts.markers import markers_around
from pentimento.control.execute import Session, execute_stroke
from pentimento.robots.driver import Robot
from pentimento.robots.tools import Tool

FloatArray = NDArray[np.float64]


def collect_strokes(
    robot: Robot, tool: Tool, config: CollectionConfig, log: Callable[[str, float, int], None]
) -> list[dict[str, Any]]:
    """Draw the strokes of ``design_collection``; rows of the ``strokes`` contract in their order.

    ``log("ink_length_m", total, i)`` is called after every stroke.
    """
    robot.change_tool(tool)
    palette = np.array(config.palette_srgb if tool.color_srgb is None else [tool.color_srgb])
    commands = design_collection(tool, robot.canvas_size_m, palette, config)
    robot.load_palette(palette)
    calibration = calibrate_camera(robot.photo(), markers_around(robot.canvas_size_m))
    session = Session(f"{tool.name}-{config.seed}", robot.clock_s)
    memory = fresh_memory(robot.canvas_size_m, tool.nominal_width_m)
    canvas = np.array([0.0, 0.0, *robot.canvas_size_m])
    shape = image_shape(canvas, config.pixels_per_m)
    rows: list[dict[str, Any]] = []
    sheet = 0
    for order, command in enumerate(commands):
        if command.sheet != sheet:
            robot.new_sheet()
            memory, sheet = new_sheet(memory), command.sheet
        window = snap_window(window_around(command.stroke.path, config.margin_m), canvas, shape)
        before = robot.photo()
        memory, executed = execute_stroke(
            robot, tool, command.stroke, palette_srgb=palette, memory=memory, session=session
        )
        robot.wait(command.wait_s)
        after = robot.photo()
        shown_before, shown_after = (
            rectify(photo, calibration, window, config.pixels_per_m) for photo in (before, after)
        )
        row = record_stroke(
            session, order, command.action_id, tool, executed, window, shown_before, shown_after, before, after,
            calibration,
        )  # fmt: skip
        rows.append(row | {"surface_id": f"sheet_{sheet}", "tool_id": f"{tool.name}_0", "camera_id": "camera_0"})
        log("ink_length_m", memory.tool_age_m, order)
    return rows
