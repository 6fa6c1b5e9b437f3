"""Photographs of recording sheets, rendered with known places and colours; see also `studies.phone_recording`."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pentimento.cli.main import main
from pentimento.collection.recording_sheet import (
    CANVAS_M,
    COMMANDS,
    Recording,
    read_recording,
    sheet_markers,
    sheet_name,
    write_recording,
)
from pentimento.collection.sheet_photo import SheetPicture, read_sheet
from pentimento.contracts.errors import CalibrationError
from pentimento.contracts.images import decode_image, read_image
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.io.photo_pairs import read_paths
from pentimento.robots.tools import load_tool
from studies.phone_recording import draw_phone, measure, painted, photograph, seen_at

Picture = NDArray[np.uint8]
SIZE_PX = (2000, 1500)
COLOR = np.array([0.1, 0.15, 0.4])
MISSED = 2
"""Strokes that nobody painted."""


class Photographed(NamedTuple):
    folder: Path
    """Of the recording."""
    before: Path
    after: Path


@pytest.fixture(scope="module")
def photographed(tmp_path_factory: pytest.TempPathFactory) -> Photographed:
    """One sheet of a marker, of which two strokes are not painted."""
    folder = tmp_path_factory.mktemp("phone")
    write_recording(folder / "recording", load_tool("marker"), 12, 4)
    blank = read_image(folder / "recording" / sheet_name(0))
    paths = read_paths(folder / "recording" / COMMANDS)
    for number, (name, own) in enumerate((("before", []), ("after", paths[MISSED:]))):
        phone, rng = draw_phone(4, number, SIZE_PX), np.random.default_rng(number)
        (folder / f"{name}.jpg").write_bytes(photograph(painted(blank, own, COLOR, 4), phone, rng))
    return Photographed(folder / "recording", folder / "before.jpg", folder / "after.jpg")


@pytest.fixture(scope="module")
def read(photographed: Photographed) -> Callable[[Picture], SheetPicture]:
    recording = read_recording(photographed.folder)
    printed = {sheet_name(0): read_image(photographed.folder / sheet_name(0))}
    return lambda frame: read_sheet(frame, recording, printed, "photo.jpg")


def run(photographed: Photographed, before: Path, after: Path, out: Path) -> int:
    return main(
        ["record", "read", str(photographed.folder), "--before", str(before), "--after", str(after), "--out", str(out)]
    )


@pytest.mark.parametrize("seed", [1, 2])
def test_a_phone_s_photographs_give_places_and_colours(seed: int, tmp_path: Path) -> None:
    found = measure(seed, tmp_path, strokes=15, size_px=SIZE_PX)
    print(found)
    assert found.met, found
    assert found.paper_delta_e < 3


def test_read_writes_the_painted_strokes_and_counts_the_others(
    photographed: Photographed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(photographed, photographed.before, photographed.after, tmp_path / "table") == 0
    printed = capsys.readouterr().out
    assert f"Refused: {MISSED} × no paint is along it (1, 2)" in printed
    rows = read_table(tmp_path / "table", CONTRACT).table.to_pylist()
    assert [row["order"] for row in rows] == list(range(MISSED, 12))
    assert {row["tool"] for row in rows} == {"marker"} and {row["medium"] for row in rows} == {"ink"}
    assert (tmp_path / "table" / "contact_sheet.png").is_file()


def test_guide_lines_are_no_paint(
    photographed: Photographed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(photographed, photographed.before, photographed.before, tmp_path / "table") == 1
    assert "No stroke was painted" in capsys.readouterr().err
    assert not (tmp_path / "table").exists()


def test_exchanged_photographs_are_refused(
    photographed: Photographed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(photographed, photographed.after, photographed.before, tmp_path / "table") == 1
    assert "exchange them" in capsys.readouterr().err


def hidden(frame: Picture) -> Picture:
    """The photograph with a thumb on the first marker."""
    covered = frame.copy()
    x, y = np.round(seen_at(draw_phone(4, 0, SIZE_PX), sheet_markers(CANVAS_M).centres_m[:1])[0]).astype(int)
    cv2.circle(covered, (int(x), int(y)), 25, (200, 150, 130), -1)
    return covered


def bulged(frame: Picture) -> Picture:
    """The photograph through a lens that bends lines by 3 % at half the diagonal."""
    height, width = frame.shape[:2]
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    x, y = columns - width / 2, rows - height / 2
    factor = 1 - 0.03 + 0.03 * (x**2 + y**2) / ((width**2 + height**2) / 4)
    moved = cv2.remap(
        frame, (x * factor + width / 2).astype(np.float32), (y * factor + height / 2).astype(np.float32), 1
    )
    return np.asarray(moved, dtype=np.uint8)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda frame: frame[:, ::-1], "mirrored"),
        (hidden, r"does not show 1 of the sheet's 8 markers \(\[8\]\)"),
        (lambda frame: cv2.GaussianBlur(frame, (0, 0), 1.8), "blurred"),
        (lambda frame: cv2.resize(frame, None, fx=0.45, fy=0.45, interpolation=cv2.INTER_AREA), "pixels a millimetre"),
        (bulged, "miss a flat sheet"),
        (lambda frame: np.full_like(frame, 128), "does not show 8"),
    ],
    ids=["mirrored", "hidden marker", "blurred", "small", "bent", "no sheet"],
)
def test_unusable_photographs_are_refused(
    change: Callable[[Picture], Picture],
    says: str,
    photographed: Photographed,
    read: Callable[[Picture], SheetPicture],
) -> None:
    frame = decode_image(photographed.before.read_bytes(), "the photograph")
    with pytest.raises(CalibrationError, match=says):
        read(np.ascontiguousarray(change(frame)))


def test_a_sheet_of_another_recording_is_refused(photographed: Photographed) -> None:
    recording = read_recording(photographed.folder)
    other = Recording(**{**vars(recording), "code": (recording.code + 500) % 1000})
    with pytest.raises(CalibrationError, match="another recording"):
        read_sheet(read_image(photographed.before), other, {}, "photo.jpg")


def test_a_turned_photograph_gives_the_same_picture(
    photographed: Photographed, read: Callable[[Picture], SheetPicture]
) -> None:
    frame = read_image(photographed.after)
    upright, turned = (read(np.ascontiguousarray(each)).canvas.astype(float) for each in (frame, np.rot90(frame)))
    assert np.abs(upright - turned).mean() < 1


def test_a_chart_in_black_and_white_is_left_out(
    photographed: Photographed, read: Callable[[Picture], SheetPicture]
) -> None:
    grey = cv2.cvtColor(read_image(photographed.before), cv2.COLOR_RGB2GRAY)
    assert read(np.repeat(grey[..., None], 3, axis=2)).colour_residual is None
