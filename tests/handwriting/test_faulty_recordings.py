"""Recordings as other programs write them: marks, labels, lost markers, units and cut-off files."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.handwriting.gather import Source, read_source
from pentimento.handwriting.motion_capture import OptiTrack, read_c3d, read_optitrack
from pentimento.handwriting.recording import XY
from tests.handwriting.test_importers import KNOWN, MARKERS, markers, motive

T = np.linspace(0, 1, 90)
PLACE = np.column_stack([0.1 * T, 0.03 * np.sin(6 * T)])
HEIGHT = np.where((T > 0.4) & (T < 0.6), 0.01, 5e-4)


def take(folder: Path, change: Callable[[list[list[str]]], Any] | None = None) -> Path:
    """A Motive export with two strokes, whose rows are changed. The pen is in columns 2 to 8."""
    path = folder / "take.csv"
    motive(path, PLACE, HEIGHT, "Meters")
    rows = [line.split(",") for line in path.read_text().split("\n")]
    if change is not None:
        change(rows)
    path.write_text("\n".join(",".join(row) for row in rows))
    return path


def test_rows_of_a_motive_export_are_found_by_their_labels(tmp_path: Path) -> None:
    expected = read_optitrack(take(tmp_path), "s", "h", KNOWN)
    assert len(expected) == 2
    for place, row in ((5, ["", "Parent", *[""] * 14]), (3, ["", "Asset", *["7"] * 14]), (1, ["", ""])):
        found = read_optitrack(take(tmp_path, lambda rows, at=place, new=row: rows.insert(at, new)), "s", "h", KNOWN)
        for one, other in zip(expected, found, strict=True):
            np.testing.assert_array_equal(one.points, other.points)


@pytest.mark.parametrize(
    "lost",
    [[""] * 7, ["nan"] * 7, [*"0001000"], [*"0000000"], [*"0001", "9999", "9999", "9999"]],
    ids=["empty", "nan", "zero", "all zero", "9999"],
)  # fmt: skip
def test_frames_in_which_the_pen_was_lost_are_unknown(tmp_path: Path, lost: list[str]) -> None:
    def lose(rows: list[list[str]]) -> None:
        for row in rows[-85:-80]:
            row[2:9] = lost

    first, _ = read_optitrack(take(tmp_path, lose), "s", "h", KNOWN)
    assert np.flatnonzero(np.isnan(first.points[:, XY]).any(axis=1)).tolist() == [5, 6, 7, 8, 9]


def test_a_canvas_that_defines_the_origin_is_not_lost(tmp_path: Path) -> None:
    def to_origin(rows: list[list[str]]) -> None:
        for row in rows[7:]:
            row[9:16] = ["0", "0", "0", "1", "0", "0", "0"]
            row[2:9] = ["0", "0", "0", "1", *(str(value) for value in (0.05 + 1e-4 * int(row[0]), 0.1505, -0.02))]

    (stroke,) = read_optitrack(take(tmp_path, to_origin), "s", "h", OptiTrack("Canvas", "Pen", 0.15, (0, -1, 0), 1e-3))
    np.testing.assert_allclose(stroke.points[[0, -1], XY], [[0.05, 0.02], [0.0589, 0.02]], atol=1e-9)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda rows: rows[-1].__delitem__(slice(9, None)), "line 90 of its frames has 9 values in place of 16"),
        (lambda rows: rows[0].extend(["Total Exported Frames", "100"]), "90 of 100 frames; it is cut off"),
        (lambda rows: rows[0].extend(["Coordinate Space", "Local"]), "'Local'; export it with Global"),
        (lambda rows: rows[20].__setitem__(5, "2.5"), "no unit quaternions"),
        (lambda rows: rows[3].__setitem__(slice(9, None), ["Pen"] * 7), "two rigid bodies 'Pen'"),
        (lambda rows: rows.pop(3), "has no lines `Name`"),
        (lambda rows: [row.__setitem__(1, str(1e3 * float(row[1]))) for row in rows[7:]], "as no person draws"),
        (lambda rows: [row.__setitem__(6, "0.3") for row in rows[7:]], "holds no stroke"),
    ],
)
def test_a_take_that_would_be_read_wrong_is_refused(tmp_path: Path, change: Any, sentence: str) -> None:
    with pytest.raises(ContractError, match=sentence):
        read_optitrack(take(tmp_path, change), "s", "h", KNOWN)


@pytest.mark.parametrize("stand_in", [0.0, 9999.0, np.nan])
def test_a_marker_with_one_number_for_its_place_is_lost(tmp_path: Path, stand_in: float) -> None:
    path = tmp_path / "take.c3d"
    markers(path, PLACE, HEIGHT, "m", stand_in=(5, stand_in))
    first, _ = read_c3d(path, "s", "h", MARKERS)
    assert np.flatnonzero(np.isnan(first.points[:, XY]).any(axis=1)).tolist() == [5]


@pytest.mark.parametrize("share", [0.4, 0.8, 0.9])
def test_c3d_that_is_cut_off_is_refused(tmp_path: Path, share: float) -> None:
    path = tmp_path / "take.c3d"
    markers(path, PLACE, HEIGHT, "m")
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * share)])
    with pytest.raises(ContractError, match=r"cut off|cannot be read as C3D"):
        read_c3d(path, "s", "h", MARKERS)


def tablet(folder: Path, **changed: Any) -> Source:
    """A tablet's recording of three strokes of 40 mm in .4 s."""
    points = [{"x": 10 + x, "y": 20 + x * x / 40, "t": x / 100, "pressure": 0.5} for x in range(40)]
    path = folder / "strokes.json"
    path.write_bytes(json.dumps({"unit": "mm", "y": "down", "strokes": [points] * 3} | changed).encode())
    return Source(str(path), "tablet", "s", "h", None, None)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-32"])
def test_json_may_begin_with_a_byte_order_mark(tmp_path: Path, encoding: str) -> None:
    source = tablet(tmp_path)
    expected = read_source(source)
    path = Path(source.path)
    path.write_bytes(path.read_text().encode(encoding))
    for one, other in zip(expected, read_source(source), strict=True):
        np.testing.assert_array_equal(one.points, other.points)


@pytest.mark.parametrize("factor", [1e3, 1e6, 1e-3])
def test_times_in_another_unit_are_refused(tmp_path: Path, factor: float) -> None:
    points = [{"x": x, "y": 0, "t": 1.7e9 * (factor > 1) + factor * x / 100} for x in range(40)]
    with pytest.raises(ContractError, match=r"mm/s .median., as no person draws; see that times are in seconds"):
        read_source(tablet(tmp_path, strokes=[points, points, points]))


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"strokes": [[[{"x": 1, "y": 2}, {"x": 2, "y": 2}]]]}, "stroke 0: a point lacks"),
        ({"strokes": [[{"x": [1, 2], "y": [2, 3]}]]}, "stroke 0: a point lacks"),
        ({"strokes": [[{"x": 1, "y": 2, "t": [0, 1]}]]}, "stroke 0: a point lacks"),
        ({"strokes": [[{"x": 10**400, "y": 2}]]}, "stroke 0: a point lacks"),
        ({"strokes": [{"x": [1, 2], "y": [2, 3]}]}, "stroke 0: a point lacks"),
        ({"strokes": [7]}, "stroke 0: a point lacks"),
        ({"strokes": [[]]}, "holds no stroke"),
        ({"y": ["down"]}, "no direction of y"),
        ({"unit": None}, "unknown unit|not a quantity"),
        ({"unit": "px"}, "give unit_m"),
    ],
)
def test_a_tablet_file_of_another_shape_is_refused(tmp_path: Path, changed: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ContractError, match=sentence):
        read_source(tablet(tmp_path, **changed))


def test_two_units_that_disagree_are_refused(tmp_path: Path) -> None:
    path = tablet(tmp_path).path
    assert len(read_source(Source(path, "tablet", "s", "h", 1e-3, None))) == 3
    with pytest.raises(ContractError, match="leave one out"):
        read_source(Source(path, "tablet", "s", "h", 1e-2, None))
    for unit_m in (0.0, -1e-3, 25.4, float("nan")):
        with pytest.raises(ValueError, match="unit_m is"):
            Source(path, "tablet", "s", "h", unit_m, None)


def test_a_json_file_that_is_cut_off_or_too_deep_is_refused(tmp_path: Path) -> None:
    source = tablet(tmp_path)
    path = Path(source.path)
    for content in (path.read_bytes()[:-200], b"[" * 100_000, b'{"strokes": "\xff"}'):
        path.write_bytes(content)
        with pytest.raises(ContractError, match="cannot be read as JSON"):
            read_source(source)


def test_lines_of_quickdraw_end_at_line_feeds_only(tmp_path: Path) -> None:
    path = tmp_path / "cats.ndjson"
    drawing = {"word": "a\u2028b\u0085c\u000bd", "drawing": [[[0, 100], [0, 50], [0, 400]]]}
    lines = [json.dumps(drawing, ensure_ascii=False)] * 2
    source = Source(str(path), "quickdraw", "q", "h", 2.5e-4, None)
    for content in ("\n".join(lines).replace("\v", ""), "\ufeff" + "\r\n".join(lines).replace("\v", "") + "\r\n"):
        path.write_text(content, encoding="utf-8", newline="")
        assert [stroke.session for stroke in read_source(source)] == ["q_1", "q_2"]
    path.write_text("\n".join(lines)[:-9].replace("\v", ""), encoding="utf-8")
    with pytest.raises(ContractError, match="line 2 is no drawing"):
        read_source(source)
    path.write_text(json.dumps({"drawing": [[[0, 100], [0, 50], [0, 0.04]]]}))  # seconds
    with pytest.raises(ContractError, match="in milliseconds"):
        read_source(source)


def test_names_of_writers_can_name_files(tmp_path: Path) -> None:
    for hand in ("Anna (left)", "O'Neil", "李", "J. Smith", "a;b"):
        assert Source("a.json", "tablet", "s", hand, None, None).hand == hand
    for hand in (
        "",
        " ",
        "a/b",
        "a\\b",
        "..",
        ".anna",
        "a\nb",
        "anna ",
        "x" * 81,
        "map",
        "strokes",
        "nobody",
        "bezier",
    ):
        with pytest.raises(ValueError, match=r"hand is .*; it names files"):
            Source("a.json", "tablet", "s", hand, None, None)
