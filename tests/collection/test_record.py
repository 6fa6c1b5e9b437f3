"""A recorded stroke is a row that the strokes contract takes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from pentimento.calibration.observe import calibrate_camera
from pentimento.collection.collect import record_stroke, stroke_views
from pentimento.contracts.covariates import fresh_memory
from pentimento.contracts.errors import ContractError
from pentimento.contracts.frames import snap_window, window_around
from pentimento.contracts.images import decode_png
from pentimento.contracts.markers import markers_around
from pentimento.contracts.plan import PlannedStroke
from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table, write_table
from pentimento.control.execute import Session, execute_stroke
from pentimento.control.guard import GuardedRobot
from pentimento.control.safety import envelope_for
from pentimento.robots.motion import timed_path
from pentimento.robots.tools import load_tool
from pentimento.robots.virtual import VirtualRobot
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import load_world

PALETTE = np.array([[0.1, 0.1, 0.5]])
PER_M = 2000


def test_a_stroke_in_the_studio_goes_through_a_file_and_back(tmp_path: Path) -> None:
    """Guarded robot, camera, act, record, Parquet: the mark lies on the commanded path."""
    tool = load_tool("round_brush")
    studio = Studio(load_world("plain"), seed=1)
    robot = GuardedRobot(VirtualRobot(studio), envelope_for(tool, studio.canvas_size_m))
    robot.change_tool(tool)
    robot.load_palette(PALETTE)
    session = Session("round_brush_0", robot.clock_s)
    blank = robot.photo()
    calibration = calibrate_camera(blank, markers_around(robot.canvas_size_m))
    assert calibration.reprojection_px < 1.0
    memory = fresh_memory(robot.canvas_size_m, tool.nominal_width_m)
    rows = []
    before = blank
    for order, y_m in enumerate((0.06, 0.14)):
        xyz_yaw = np.zeros((32, 4))
        xyz_yaw[:, 0], xyz_yaw[:, 1], xyz_yaw[:, 2] = np.linspace(0.12, 0.17, 32), y_m, -0.002
        stroke = PlannedStroke(timed_path(xyz_yaw, 0.06), PALETTE[0], dip=order == 0)
        memory, executed = execute_stroke(robot, tool, stroke, palette_srgb=PALETTE, memory=memory, session=session)
        after = robot.photo()
        window = snap_window(window_around(stroke.path, 0.015), (0, 0, *robot.canvas_size_m), (400, 600))
        views = stroke_views(before, after, calibration, window_m=window, pixels_per_m=PER_M)
        rows.append(record_stroke(session, executed, views, order=order, action_id=order, tool=tool))
        before = after

    schema = arrow_schema(CONTRACT, include_optional=set(rows[0]))
    folder = tmp_path / "strokes"
    write_table(folder, pa.Table.from_pylist(rows, schema=schema), CONTRACT, "# Strokes\n")
    checked = read_table(folder, CONTRACT)
    assert not checked.quarantined and checked.table.num_rows == 2
    for row, y_m in zip(checked.table.to_pylist(), (0.06, 0.14), strict=True):
        x_min, y_min, x_max, y_max = row["window_m"]
        assert x_min < 0.12 and x_max > 0.17 and y_min < y_m < y_max
        dark = decode_png(row["before"]["bytes"]).astype(float) - decode_png(row["after"]["bytes"])
        dark = np.clip(dark.mean(axis=-1) - 40, 0, None)
        place_rows, _ = np.mgrid[0 : dark.shape[0], 0 : dark.shape[1]]
        mark_y_m = y_max - ((place_rows * dark).sum() / dark.sum() + 0.5) / PER_M
        assert mark_y_m == pytest.approx(y_m, abs=1.5e-3)
        assert row["t_before_s"] < row["t_start_s"] < row["t_after_s"]
        assert np.isfinite(row["measured_path"]).all()
        assert len(row["force_n"]) == 32 and np.isfinite(row["force_n"]).all()
        assert row["tool"] == "round_brush" and row["medium"] == "acrylic"
        box = np.array(row["window_px"])
        assert (box > 0).all() and box[2] < row["frame_size_px"][0] and box[3] < row["frame_size_px"][1]
    first, second = checked.table.to_pylist()
    assert (first["since_reload"], second["since_reload"]) == (0, 1)
    assert second["ink_since_reload_m"] == pytest.approx(0.05, rel=1e-3)
    assert second["t_before_s"] == first["t_after_s"]


def test_images_that_do_not_belong_together_are_refused() -> None:
    tool = load_tool("round_brush")
    studio = Studio(load_world("plain"), seed=1)
    robot = VirtualRobot(studio)
    robot.load_palette(PALETTE)
    photo = robot.photo()
    calibration = calibrate_camera(photo, markers_around(robot.canvas_size_m))
    xyz_yaw = np.zeros((8, 4))
    xyz_yaw[:, 0], xyz_yaw[:, 1] = np.linspace(0.1, 0.12, 8), 0.1
    stroke = PlannedStroke(timed_path(xyz_yaw, 0.06), PALETTE[0], dip=True)
    _, executed = execute_stroke(
        robot,
        tool,
        stroke,
        palette_srgb=PALETTE,
        memory=fresh_memory(robot.canvas_size_m),
        session=Session("s", robot.clock_s),
    )
    window = np.array([0.09, 0.09, 0.13, 0.11])
    views = stroke_views(photo, photo, calibration, window_m=window, pixels_per_m=PER_M)

    def record(before: np.ndarray, after: np.ndarray) -> None:
        given = replace(views, before=before, after=after)
        record_stroke(Session("s", 0.0), executed, given, order=0, action_id=0, tool=tool)

    with pytest.raises(ContractError, match="rectify both to one window"):
        record(views.before, views.after[:-1])
    with pytest.raises(ContractError, match="pixels must be square"):
        record(views.before[:20], views.after[:20])
