"""Importers: recordings in metres with y up; unreadable files are rejected with a message."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Literal

import c3d
import numpy as np
import pytest

from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.handwriting.gather import Source, gather, read_source
from pentimento.handwriting.json_recordings import read_quickdraw, read_tablet
from pentimento.handwriting.motion_capture import C3D, OptiTrack, read_c3d, read_optitrack
from pentimento.handwriting.recording import XY, Z
from pentimento.handwriting.repair import Limits
from pentimento.handwriting.svg_recordings import read_svg
from pentimento.svg.path_data import flattened

KNOWN = OptiTrack("Canvas", "Pen", pen_length_m=0.15, tip_axis=(0.0, -1.0, 0.0), contact_m=2e-3)


def rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    """Quaternion x, y, z, w."""
    return np.append(np.sin(angle / 2) * axis / np.linalg.norm(axis), np.cos(angle / 2))


def matrix(q: np.ndarray) -> np.ndarray:
    x, y, z, w = q
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def motive(
    path: Path, place: np.ndarray, height: np.ndarray, unit: str = "Millimeters", lost: tuple[int, ...] = ()
) -> None:
    """A tilted canvas and a leaning pen with its tip at these places [K, 2] and heights over the canvas."""
    to_unit = {"Millimeters": 1e3, "Meters": 1.0}.get(unit, 1.0)
    canvas_q, pen_q = rotation(np.array([0.3, 1.0, 0.2]), 0.8), rotation(np.array([1.0, 0.0, 0.5]), 0.4)
    canvas_at = np.array([0.4, 0.9, -0.2])
    own = np.column_stack([place[:, 0], height, -place[:, 1]])
    tip = canvas_at + own @ matrix(canvas_q).T
    pen_at = tip - 0.15 * matrix(pen_q) @ np.array([0.0, -1.0, 0.0])
    head = [
        ["Format Version", "1.23", "Take Name", "take", "Length Units", unit], [],
        ["", "Type", *["Rigid Body"] * 14], ["", "Name", *["Pen"] * 7, *["Canvas"] * 7], ["", "ID", *["1"] * 14],
        ["", "", *(["Rotation"] * 4 + ["Position"] * 3) * 2],
        ["Frame", "Time (Seconds)", *["X", "Y", "Z", "W", "X", "Y", "Z"] * 2],
    ]  # fmt: skip
    rows = []
    for k in range(len(place)):
        pen = ["" for _ in range(7)] if k in lost else [*pen_q, *(pen_at[k] * to_unit)]
        rows.append([k, k / 200, *pen, *canvas_q, *(canvas_at * to_unit)])
    path.write_text("\n".join(",".join(map(str, row)) for row in [*head, *rows]))


@pytest.mark.parametrize(
    ("unit", "known", "sentence"),
    [("Furlongs", KNOWN, "length units"), ("Meters", OptiTrack("Sheet", "Pen", 0.1, (0, -1, 0), 1e-3), "'Sheet'")],
)
def test_read_optitrack_rejects_missing_unit_or_body(
    tmp_path: Path, unit: str, known: OptiTrack, sentence: str
) -> None:
    motive(tmp_path / "take.csv", np.zeros((3, 2)), np.zeros(3), unit)
    with pytest.raises(ContractError, match=sentence):
        read_optitrack(tmp_path / "take.csv", "s", "h", known)


MARKERS = C3D(("origin", "right", "far"), raised_m=7e-3, pen=("cap", "grip"), tip_m=0.08, contact_m=2e-3)


def markers(
    path: Path,
    place: np.ndarray,
    height: np.ndarray,
    unit: str,
    lost: tuple[int, ...] = (),
    stand_in: tuple[int, float] = (-1, 0.0),
) -> None:
    """The same canvas and pen as single markers, whose middles lie 7 mm over the sheet.

    In the frame ``stand_in[0]``, the cap has the other number for all coordinates.
    """
    to_unit = {"mm": 1e3, "m": 1.0}.get(unit, 1.0)
    turned = matrix(rotation(np.array([0.3, 1.0, 0.2]), 0.8))  # columns: x, y and up of the canvas
    at = np.array([0.4, 0.9, -0.2])
    axis = matrix(rotation(np.array([1.0, 0.0, 0.5]), 0.4)) @ np.array([0.0, 0.0, -1.0])
    tips = at + np.column_stack([place, height]) @ turned.T
    corners = np.array([[0, 0, 7e-3], [0.2, 0, 7e-3], [0.03, 0.15, 7e-3]])  # the third is not square to x
    canvas = at + corners @ turned.T
    writer = c3d.Writer(point_rate=200.0, point_units=unit)
    writer.set_point_labels(["right", "origin", "far", "grip", "cap"])
    frames = []
    for k, tip in enumerate(tips):
        seen = np.array([canvas[1], canvas[0], canvas[2], tip - 0.08 * axis, tip - 0.14 * axis]) * to_unit
        seen[4] = stand_in[1] if k == stand_in[0] else seen[4]
        residual = np.array([0, 0, 0, 0, -1 if k in lost else 0])
        frames.append((np.column_stack([seen, residual, np.zeros(5)]), np.zeros((0, 0))))
    writer.add_frames(frames)
    with path.open("wb") as file, pytest.warns(UserWarning, match="No analog data"):
        writer.write(file)


@pytest.mark.parametrize("unit", ["mm", "m"])
@pytest.mark.parametrize("format", ["optitrack", "c3d"])
def test_motion_capture_finds_the_tip_on_a_tilted_canvas(
    tmp_path: Path, format: Literal["optitrack", "c3d"], unit: str
) -> None:
    t = np.linspace(0, 1, 90)
    place = np.column_stack([0.1 * t, 0.03 * np.sin(6 * t)])
    height = np.where((t > 0.4) & (t < 0.6), 0.01, 5e-4)
    if format == "c3d":
        markers(tmp_path / "take", place, height, unit, lost=(10, 11))
    else:
        motive(tmp_path / "take", place, height, {"mm": "Millimeters", "m": "Meters"}[unit], lost=(10, 11))
    first, second = read_source(Source(str(tmp_path / "take"), format, "s", "h", None, KNOWN, MARKERS))
    assert len(first.points) + len(second.points) == (height < 2e-3).sum()
    whole = np.isfinite(first.points[:, XY]).all(axis=1)
    assert np.flatnonzero(~whole).tolist() == [10, 11]
    rounded = 1e-9 if format == "optitrack" else 2e-6  # C3D has single precision
    np.testing.assert_allclose(first.points[whole][:, XY], place[: len(first.points)][whole], atol=rounded)
    np.testing.assert_allclose(second.points[:, Z], 5e-4, atol=rounded)
    assert second.points[1, 0] - second.points[0, 0] == pytest.approx(1 / 200)


def test_read_c3d_rejects_unusable_files(tmp_path: Path) -> None:
    path = tmp_path / "take.c3d"
    markers(path, np.zeros((3, 2)), np.zeros(3), "ft")
    with pytest.raises(ContractError, match="'ft' for its unit"):
        read_c3d(path, "s", "h", MARKERS)
    markers(path, np.zeros((3, 2)), np.zeros(3), "mm")
    with pytest.raises(ContractError, match="no marker 'nib'; its markers are"):
        read_c3d(path, "s", "h", replace(MARKERS, pen=("cap", "nib")))
    with pytest.raises(ConfigError, match="needs the entry `c3d`"):
        read_source(Source(str(path), "c3d", "s", "h", None, None))
    for content in (b"", b"no motion capture", path.read_bytes()[:600]):
        path.write_bytes(content)
        with pytest.raises(ContractError, match="cannot be read as C3D"):
            read_c3d(path, "s", "h", MARKERS)


def test_read_tablet_turns_y_up_and_needs_a_unit(tmp_path: Path) -> None:
    path = tmp_path / "strokes.json"
    strokes = [[{"x": 10, "y": 20, "pressure": 0.3, "t": 0.0}, {"x": 30, "y": 60, "pressure": 0.4, "t": 0.1}], []]
    path.write_text(json.dumps({"unit": "mm", "y": "down", "strokes": strokes}))
    (stroke,) = read_tablet(path, "s", "h", None)
    np.testing.assert_allclose(stroke.points[:, [0, 1, 2, 4]], [[0, 0.01, -0.02, 0.3], [0.1, 0.03, -0.06, 0.4]])
    path.write_text(json.dumps({"y": "up", "strokes": strokes}))
    with pytest.raises(ContractError, match="has no unit of length"):
        read_tablet(path, "s", "h", None)
    np.testing.assert_allclose(read_tablet(path, "s", "h", 2e-3)[0].points[1, XY], [0.06, 0.12])
    path.write_text(json.dumps({"unit": "mm", "strokes": strokes}))
    with pytest.raises(ContractError, match="no direction of y"):
        read_tablet(path, "s", "h", None)
    path.write_text(json.dumps({"unit": "mm", "y": "up", "strokes": [[{"x": 1}]]}))
    with pytest.raises(ContractError, match="stroke 0: a point lacks"):
        read_tablet(path, "s", "h", None)


def test_read_quickdraw_reads_one_drawing_per_line(tmp_path: Path) -> None:
    path = tmp_path / "cats.ndjson"
    drawing = {"word": "cat", "drawing": [[[0, 100], [0, 50], [0, 40]], [[5, 6], [7, 9]]]}
    path.write_text(json.dumps(drawing) + "\n\n" + json.dumps(drawing) + "\n")
    found = read_quickdraw(path, "q", "h", 1e-3)
    assert [stroke.session for stroke in found] == ["q_1", "q_1", "q_3", "q_3"]
    np.testing.assert_allclose(found[0].points[1, :3], [0.04, 0.1, -0.05])
    assert np.isnan(found[1].points[:, 0]).all()
    path.write_text('{"drawing": [[[1, 2]]]}')
    with pytest.raises(ContractError, match="line 1"):
        read_quickdraw(path, "q", "h", 1e-3)


def test_read_svg_flattens_paths_with_y_up(tmp_path: Path) -> None:
    path = tmp_path / "drawing.svg"
    path.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="100mm" viewBox="0 0 200 100"><g>'
        '<path d="M10,10 h20 v10z m100 0 q10 -20 20 0"/><line x1="0" y1="0" x2="40" y2="20"/>'
        '<polygon points="0,0 10,0 10,10"/></g></svg>'
    )
    closed, curve, line, polygon = (stroke.points[:, XY] for stroke in read_svg(path, "s", "h", None))
    np.testing.assert_allclose(closed, [[0.005, -0.005], [0.015, -0.005], [0.015, -0.01], [0.005, -0.005]])
    np.testing.assert_allclose(curve[0], [0.055, -0.005])
    assert curve[:, 1].max() == pytest.approx(0.0, abs=1e-9)  # a quadratic reaches half its control's height
    np.testing.assert_allclose(line, [[0, 0], [0.02, -0.01]])
    np.testing.assert_allclose(polygon[0], polygon[-1])
    path.write_text('<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 0 L1 1"/></svg>')
    with pytest.raises(ContractError, match="width as a length"):
        read_svg(path, "s", "h", None)


def test_svg_arc_is_circular() -> None:
    (arc,) = flattened("M 1 0 A 1 1 0 0 1 -1 0")
    np.testing.assert_allclose(np.linalg.norm(arc, axis=1), 1, atol=1e-9)
    assert arc[:, 1].max() == pytest.approx(1)  # sweep 1 turns towards +y, which is down
    (small,) = flattened("M0 0a.1.1 0 1 0 10 0")
    np.testing.assert_allclose(small[-1], [10, 0])  # radii that are too small grow until the arc fits


@pytest.mark.parametrize("d", ["L 1 1", "M 0 0 C 1 1", "M 0 0 X 3", "M 0 0 L 1 1 Z 4 4", "M 0 0 L #"])
def test_svg_rejects_invalid_path_data(d: str) -> None:
    with pytest.raises((ValueError, IndexError)):
        flattened(d)


def test_gather_builds_one_table(tmp_path: Path) -> None:
    path = tmp_path / "strokes.json"
    stroke = [{"x": x, "y": x * x / 40, "t": x / 100} for x in range(40)]
    path.write_text(json.dumps({"unit": "mm", "y": "down", "strokes": [stroke, stroke[:1], stroke]}))
    source = Source(str(path), "tablet", "first", "ann", None, None)
    found = gather(read_source(source), Limits(5, 3e-3, 8.0, 1e-3, 0.6), 32)
    assert found.table.column("index").to_pylist() == [0, 1]
    assert (found.counts["kept"], found.counts["refused"], found.counts["without_pressure"]) == (2, 1, 2)
    assert found.counts["faults"]["strokes_of_one_point"] == 1
    with pytest.raises(ConfigError, match="unit_m"):
        read_source(Source(str(path), "quickdraw", "s", "h", None, None))
    with pytest.raises(ContractError, match="None of the 1"):
        gather(read_source(source)[1:2], Limits(5, 3e-3, 8.0, 1e-3, 0.6), 32)
