"""Recordings on disk: a shard per batch, complete after every stroke."""

from pathlib import Path

import numpy as np
import pytest

from pentimento.calibration.observe import calibrate_camera
from pentimento.contracts.covariates import fresh_memory
from pentimento.contracts.markers import markers_around
from pentimento.contracts.plan import PlannedStroke
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.control import recording
from pentimento.control.execute import Session, execute_stroke
from pentimento.control.recording import StrokeRecording
from pentimento.robots.motion import timed_path
from pentimento.robots.tools import load_tool
from tests.bundle.line_brush import SIDE_M, sheet

TOOL = load_tool("marker")
SIZE_M = (SIDE_M, SIDE_M)


def _record(folder: Path, numbers: range, full_at: int | None, monkeypatch: pytest.MonkeyPatch) -> StrokeRecording:
    robot, memory = sheet(), fresh_memory(SIZE_M, 0.002)
    session = Session("s", robot.clock_s)
    recorder = StrokeRecording(folder, 0, session, tool=TOOL, canvas_size_m=SIZE_M)
    camera, before = calibrate_camera(robot.photo(), markers_around(SIZE_M)), robot.photo()
    ink = np.array([TOOL.color_srgb])
    for number in numbers:
        y_m = 0.01 + 0.01 * number
        line = np.array([[0.02, y_m, -0.0005, 0], [0.05, y_m, -0.0005, 0], [0.08, y_m, -0.0005, 0]])
        planned = PlannedStroke(timed_path(line, 0.06), ink[0], dip=False)
        memory, executed = execute_stroke(robot, TOOL, planned, palette_srgb=ink, memory=memory, session=session)
        after = robot.photo()
        with monkeypatch.context() as patch:
            if number == full_at:
                patch.setattr(recording, "atomic_write", _full)
                with pytest.raises(OSError, match="space"):
                    recorder.add(number, executed, before=before, after=after, camera=camera)
                continue
            recorder.add(number, executed, before=before, after=after, camera=camera)
        before = after
        if number % 2:
            recorder.next_batch()
    return recorder


def _full(_path: Path, _data: bytes) -> None:
    raise OSError(28, "No space left on device")


def test_recording_writes_a_shard_per_batch_and_a_row_per_stroke(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = _record(tmp_path, range(5), None, monkeypatch)
    assert [file.name for file in sorted(tmp_path.iterdir())] == [f"part-{n:05d}.parquet" for n in range(3)]
    found = read_table(tmp_path, CONTRACT)
    assert found.table["order"].to_pylist() == [0, 1, 2, 3, 4] and not found.quarantined
    assert recorder.shard == 2
    recorder.next_batch()
    recorder.next_batch()  # without a row between them
    assert recorder.shard == 3


def test_recording_on_a_full_disk_keeps_earlier_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _record(tmp_path, range(3), 1, monkeypatch)
    assert read_table(tmp_path, CONTRACT).table["order"].to_pylist() == [0, 2]
