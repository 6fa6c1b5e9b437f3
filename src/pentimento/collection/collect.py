"""Self-generated strokes: the robot marks its own paper by design and photographs every mark (thesis 4.3.2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.calibration.observe import CameraCalibration, Image, calibrate_camera, rectify, window_in_camera
from pentimento.collection.design import CollectionConfig, design_collection
from pentimento.contracts.covariates import fresh_memory, new_sheet
from pentimento.contracts.errors import ContractError
from pentimento.contracts.frames import image_shape, pixels_per_m, snap_window, window_around
from pentimento.contracts.images import encode_png
from pentimento.contracts.markers import markers_around
from pentimento.contracts.observations import Photo
from pentimento.control.execute import ExecutedStroke, Session, execute_stroke
from pentimento.planning.strokes.shapes import Shapes
from pentimento.robots.driver import Robot
from pentimento.robots.tools import Tool


@dataclass(frozen=True)
class StrokeViews:
    """What the camera saw of a stroke."""

    photo_before: Photo
    photo_after: Photo
    calibration: CameraCalibration
    window_m: FloatArray
    """[4], canvas frame."""
    before: Image
    """uint8 sRGB [H, W, 3]: the window, rectified."""
    after: Image


def stroke_views(
    before: Photo, after: Photo, calibration: CameraCalibration, *, window_m: FloatArray, pixels_per_m: float
) -> StrokeViews:
    """The views of a stroke, rectified from the photographs before and after it.

    Raises CalibrationError if the calibration is of other frames or the window lies partly outside the frame.
    """
    shown = (rectify(photo, calibration, window_m, pixels_per_m) for photo in (before, after))
    return StrokeViews(before, after, calibration, window_m, *shown)


def record_stroke(
    session: Session, executed: ExecutedStroke, views: StrokeViews, *, order: int, action_id: int, tool: Tool
) -> dict[str, Any]:
    """One row of the `strokes` contract, in its Python form (`pyarrow.Table.from_pylist` takes it).

    What was not measured is null. Identities (surface, camera, …) and further covariates are the caller's to add:
    `row | {"temperature_c": 21.5}`.

    Raises ContractError if the images differ in shape or do not fit the window.
    """
    before, after, window_m, photo_after = views.before, views.after, views.window_m, views.photo_after
    if before.shape != after.shape:
        raise ContractError(f"The image before is {before.shape} and after {after.shape}; rectify both to one window.")
    pixels_per_m(before.shape, window_m)
    event = executed.event
    measured, force_n = executed.measured_path, executed.force_n
    return {
        "session": session.name,
        "order": order,
        "action_id": action_id,
        "tool": tool.name,
        "medium": tool.medium,
        "path": event.path.tolist(),
        "window_m": [float(value) for value in window_m],
        "before": {"bytes": encode_png(before), "path": None},
        "after": {"bytes": encode_png(after), "path": None},
        "frame": "canvas",
        "encoding": "srgb",
        "color_srgb": [float(value) for value in event.color_srgb],
        "t_start_s": event.t_start_s,
        "t_before_s": views.photo_before.t_s - session.started_s,
        "t_after_s": photo_after.t_s - session.started_s,
        **executed.covariates,
        "measured_path": measured.tolist() if np.all(np.isfinite(measured[:, 1:])) else None,
        "force_n": force_n.tolist() if force_n.size and np.all(np.isfinite(force_n)) else None,
        "window_px": window_in_camera(views.calibration, window_m).tolist(),
        "frame_size_px": list(views.calibration.frame_size_px),
        "exposure_s": photo_after.exposure_s,
        "gain": photo_after.gain,
        "white_balance": [float(value) for value in photo_after.white_balance],
    }


FloatArray = NDArray[np.float64]


def collect_strokes(
    robot: Robot,
    tool: Tool,
    config: CollectionConfig,
    log: Callable[[str, float, int], None],
    shapes: Shapes | None = None,
) -> list[dict[str, Any]]:
    """Draw the strokes of ``design_collection``; rows of the ``strokes`` contract in their order.

    ``log("ink_length_m", total, i)`` is called after every stroke.
    """
    robot.change_tool(tool)
    palette = np.array(config.palette_srgb if tool.color_srgb is None else [tool.color_srgb])
    commands = design_collection(tool, robot.canvas_size_m, palette, config, shapes)
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
        views = stroke_views(before, after, calibration, window_m=window, pixels_per_m=config.pixels_per_m)
        row = record_stroke(session, executed, views, order=order, action_id=command.action_id, tool=tool)
        rows.append(row | {"surface_id": f"sheet_{sheet}", "tool_id": f"{tool.name}_0", "camera_id": "camera_0"})
        log("ink_length_m", memory.tool_age_m, order)
    return rows
