"""Recording sheets: strokes alone in cells, repeats in one place, and prints that are true to the millimetre."""

import re
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
import pytest

from pentimento.collection.recording_sheet import (
    CANVAS_M,
    CODES,
    COMMANDS,
    PRINT_PX_PER_M,
    Recording,
    paper_window,
    read_recording,
    sheet_markers,
    sheet_name,
    write_recording,
)
from pentimento.contracts.errors import ContractError
from pentimento.contracts.frames import canvas_to_pixel
from pentimento.contracts.images import read_image
from pentimento.contracts.markers import DICTIONARY
from pentimento.io.photo_pairs import read_paths
from pentimento.io.stroke_rows import RecordedPath
from pentimento.robots.motion import tip_speeds
from pentimento.robots.tools import load_tool

BRUSH = load_tool("round_brush")
STROKES = 32


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("recording") / "sheets"
    write_recording(place, BRUSH, STROKES, 0)
    return place


@pytest.fixture(scope="module")
def recording(folder: Path) -> Recording:
    return read_recording(folder)


@pytest.fixture(scope="module")
def strokes(folder: Path) -> list[RecordedPath]:
    return read_paths(folder / COMMANDS)


def test_each_stroke_is_alone_in_its_cell(recording: Recording, strokes: list[RecordedPath]) -> None:
    half = BRUSH.nominal_width_m / 2
    cells: Counter[tuple[object, ...]] = Counter()
    for stroke in strokes:
        cell, xy = recording.cell_around(stroke.path), stroke.path[:, 1:3]
        assert (xy > cell[:2] + half).all() and (xy < cell[2:] - half).all()
        cells[stroke.about["surface_id"], *cell.round(6)] += 1
    assert len(cells) == len(strokes) == STROKES and recording.sheets == 3


def test_repeats_are_one_path_in_one_place_of_different_sheets(strokes: list[RecordedPath]) -> None:
    by_action: dict[int, list[RecordedPath]] = {}
    for stroke in strokes:
        by_action.setdefault(stroke.about["action_id"], []).append(stroke)
    repeated = [again for again in by_action.values() if len(again) > 1]
    assert [len(again) for again in repeated] == [3, 3, 3]
    for again in repeated:
        assert len({stroke.about["surface_id"] for stroke in again}) == 3
        assert all(np.array_equal(stroke.path, again[0].path) for stroke in again)
        assert all(stroke.about["since_reload"] == 0 for stroke in again)


def test_commands_keep_the_tool_s_ranges(strokes: list[RecordedPath]) -> None:
    """The file rounds times to 0.1 ms, which changes the speed of steps of 10 ms by a percent."""
    for number, stroke in enumerate(strokes):
        assert stroke.fault is None and stroke.about["order"] == number
        assert (-stroke.path[:, 3] <= BRUSH.press_range_m[1] + 1e-6).all()
        assert tip_speeds(stroke.path).max() <= 1.02 * BRUSH.speed_range_m_s[1]
        assert 0 <= stroke.about["since_reload"] < BRUSH.strokes_per_dip


def test_markers_are_printed_where_the_reader_takes_them_to_be(folder: Path, recording: Recording) -> None:
    layout = sheet_markers(recording.canvas_size_m)
    picture = cv2.cvtColor(read_image(folder / sheet_name(1)), cv2.COLOR_RGB2GRAY)
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY)))
    corners, ids, _ = detector.detectMarkers(picture)
    assert sorted(ids.ravel()) == sorted(layout.ids)
    expected = canvas_to_pixel(layout.corners_m(), paper_window(CANVAS_M), PRINT_PX_PER_M)
    for found, marker in zip(corners, ids.ravel(), strict=True):
        miss_m = np.abs(found[0] - expected[layout.ids.index(marker)]).max() / PRINT_PX_PER_M
        assert miss_m < 1e-4


def test_the_code_tells_the_sheet_and_the_recording(folder: Path, recording: Recording) -> None:
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, CODES)))
    for sheet in range(recording.sheets):
        _, ids, _ = detector.detectMarkers(read_image(folder / sheet_name(sheet)))
        assert [recording.sheet_of(int(code)) for code in ids.ravel()] == [sheet]
    assert recording.sheet_of(recording.code_of(recording.sheets)) is None


def test_the_pages_are_a4(folder: Path, recording: Recording) -> None:
    pages = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", (folder / "sheets.pdf").read_bytes())
    assert len(pages) == recording.sheets
    for page in pages:
        assert [float(points) / 72 * 25.4 for points in page] == pytest.approx([297, 210], abs=0.05)


def test_a_folder_without_a_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ContractError, match="pentimento record sheet"):
        read_recording(tmp_path)
