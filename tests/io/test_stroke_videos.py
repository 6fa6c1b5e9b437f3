"""Tests of the import of videos: a tilted camera films a sheet with markers, and a line that appears on it."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from pentimento.cli.main import main
from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import decode_png, write_png
from pentimento.contracts.markers import DICTIONARY, MarkerLayout
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.io.marker_views import read_markers, rectified
from pentimento.io.stroke_rows import Placement, Refused
from pentimento.io.stroke_videos import first_and_last, import_videos
from tests.io.photographed import written

WINDOW = "0 mm, 0 mm, 100 mm, 60 mm"
PLACE = Placement.parsed(WINDOW, None, False)
LINE_MM = np.array([[25.0, 20.0], [70.0, 40.0]])
MARKERS_MM = {3: (-10.0, -10.0), 7: (110.0, -10.0), 11: (110.0, 70.0), 20: (-10.0, 70.0)}
SIDE_MM = 14.0
TABLE_MM = (-25.0, -25.0, 125.0, 85.0)
FINE = 10
"""Pixels a mm of the flat scene."""
FRAME = (800, 600)


def pixel(xy_mm: np.ndarray) -> np.ndarray:
    """Column and row in the scene."""
    return (np.asarray(xy_mm) - [TABLE_MM[0], TABLE_MM[3]]) * [FINE, -FINE] - 0.5


def scene(inked: bool) -> np.ndarray:
    width, height = ((TABLE_MM[2 + axis] - TABLE_MM[axis]) * FINE for axis in (0, 1))
    drawn = np.full((int(height), int(width), 3), 235, np.uint8)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY))
    side = int(SIDE_MM * FINE)
    for marker, centre in MARKERS_MM.items():
        column, row = np.round(pixel(np.array(centre)) + 0.5 - side / 2).astype(int)
        drawn[row : row + side, column : column + side] = cv2.aruco.generateImageMarker(dictionary, marker, side)[
            ..., None
        ]
    if inked:
        cv2.polylines(drawn, [np.round(pixel(LINE_MM)).astype(np.int32)], False, (30, 30, 40), 2 * FINE)
    return drawn


def frame(inked: bool, shift_px: float = 0.0) -> np.ndarray:
    """What the tilted camera sees."""
    flat = scene(inked)
    height, width = flat.shape[:2]
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    seen = np.array([[60, 40], [740, 70], [780, 570], [20, 540]], np.float32) + np.float32(shift_px)
    matrix = cv2.getPerspectiveTransform(corners, seen)
    return cv2.warpPerspective(flat, matrix, FRAME, flags=cv2.INTER_AREA, borderValue=(90, 80, 70))


def film(path: Path, frames: list[np.ndarray]) -> Path:
    path.parent.mkdir(exist_ok=True)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 25, FRAME)
    assert writer.isOpened()
    for each in frames:
        writer.write(np.ascontiguousarray(each[..., ::-1]))
    writer.release()
    return path


def markers(folder: Path, more: str = "") -> Path:
    path = folder / "markers.csv"
    lines = [f"{marker},{x},{y},{SIDE_MM}" for marker, (x, y) in MARKERS_MM.items()]
    path.write_text("\n".join(["marker,x_mm,y_mm,side_mm", *lines]) + f"\n{more}")
    return path


def paths(folder: Path, names: tuple[str, ...] = ("s0",)) -> Path:
    rows = [f"{name},{at},{x},{y},-1" for name in names for at, (x, y) in enumerate(LINE_MM)]
    return written(folder, ["stroke,t_s,x_mm,y_mm,z_mm", *rows])


def moved(xy_mm: np.ndarray) -> list[np.ndarray]:
    """A film in which the line appears behind a hand."""
    hand = frame(True)
    hand[250:400, 300:500] = (200, 160, 140)
    return [frame(False)] * 3 + [hand] * 3 + [frame(True)] * 3


def test_the_first_and_the_last_frame_are_before_and_after(tmp_path: Path) -> None:
    film(tmp_path / "films/s0.mp4", moved(LINE_MM))
    command = ["import", str(paths(tmp_path)), "--markers", str(markers(tmp_path)), "--window", WINDOW]
    for place, out in ((tmp_path / "films", "folder"), (tmp_path / "films/s0.mp4", "file")):
        assert main([*command, "--video", str(place), "--tool", "quill", "--out", str(tmp_path / out)]) == 0
        (row,) = read_table(tmp_path / out, CONTRACT).table.to_pylist()
        np.testing.assert_allclose(np.array(row["path"])[:, 1:3], 1e-3 * LINE_MM, atol=1e-6)
        before, after = (decode_png(row[name]["bytes"]).astype(int) for name in ("before", "after"))
        ink = np.argwhere((before - after).mean(-1) > 100)
        scale = before.shape[1] / (1e3 * (row["window_m"][2] - row["window_m"][0]))
        x = 1e3 * row["window_m"][0] + (ink[:, 1] + 0.5) / scale
        y = 1e3 * row["window_m"][3] - (ink[:, 0] + 0.5) / scale
        along = (LINE_MM[1] - LINE_MM[0]) / np.linalg.norm(LINE_MM[1] - LINE_MM[0])
        off = (x - LINE_MM[0, 0]) * along[1] - (y - LINE_MM[0, 1]) * along[0]
        assert abs(off.mean()) < 0.1 and np.abs(off).max() < 1.5  # mm; the line is 2 mm wide
        ends = (x - LINE_MM[0, 0]) * along[0] + (y - LINE_MM[0, 1]) * along[1]
        assert ends.max() - ends.min() == pytest.approx(np.linalg.norm(LINE_MM[1] - LINE_MM[0]) + 2, abs=0.6)
        assert (tmp_path / out / "contact_sheet.png").is_file()


@pytest.mark.parametrize("with_blank", [False, True])
def test_a_photograph_of_a_page_is_rectified_by_markers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], with_blank: bool
) -> None:
    """The blank page is photographed by another pose of the camera."""
    write_png(tmp_path / "page.png", frame(True))
    write_png(tmp_path / "blank.png", frame(False, shift_px=9.0))
    command = ["import", str(paths(tmp_path)), "--page", str(tmp_path / "page.png"), "--tool", "quill"]
    command += ["--markers", str(markers(tmp_path)), "--out", str(tmp_path / "out")]
    command += ["--blank", str(tmp_path / "blank.png")] if with_blank else []
    assert main([*command, "--window", WINDOW]) == 0
    (row,) = read_table(tmp_path / "out", CONTRACT).table.to_pylist()
    before, after = (decode_png(row[name]["bytes"]).astype(int) for name in ("before", "after"))
    x_min, _, x_max, y_max = 1e3 * np.array(row["window_m"])
    middle = (LINE_MM.mean(0) - [x_min, y_max]) * [1, -1] * before.shape[1] / (x_max - x_min)
    assert after[int(middle[1]), int(middle[0])].max() < 80 and (before > 150).all()
    assert main([*command, "--scale", "5 px/mm"]) == 1
    assert "needs --window" in capsys.readouterr().err
    write_png(tmp_path / "page.png", frame(True)[:300])
    assert main([*command, "--window", WINDOW]) == 1
    assert "page.png or its blank page is not usable: its camera cannot be registered" in capsys.readouterr().err


def test_y_may_grow_downwards_in_paths_and_markers(tmp_path: Path) -> None:
    """In a frame that is mirrored within the same window, all that is said of the sheet gives the same row."""
    film(tmp_path / "films/s0.mp4", moved(LINE_MM))
    import_videos(paths(tmp_path), tmp_path / "films", markers(tmp_path), PLACE, "quill", tmp_path / "up")
    rows = [f"s0,{at},{x},{60 - y},-1" for at, (x, y) in enumerate(LINE_MM)]
    down = written(tmp_path, ["stroke,t_s,x_mm,y_mm,z_mm", *rows])
    mirrored = tmp_path / "mirrored.csv"
    lines = [f"{marker},{x},{60 - y},{SIDE_MM}" for marker, (x, y) in MARKERS_MM.items()]
    mirrored.write_text("\n".join(["marker,x_mm,y_mm,side_mm", *lines]))
    place = Placement.parsed(WINDOW, None, True)
    import_videos(down, tmp_path / "films", mirrored, place, "quill", tmp_path / "down")
    up, down_rows = (read_table(tmp_path / name, CONTRACT).table.to_pylist() for name in ("up", "down"))
    np.testing.assert_allclose(up[0]["path"], down_rows[0]["path"], atol=1e-9)
    assert up[0]["after"] == down_rows[0]["after"]


def test_videos_that_cannot_be_used_are_counted(tmp_path: Path) -> None:
    names = ("good", "moved", "hidden", "short", "text", "missing")
    films = tmp_path / "films"
    film(films / "good.mp4", moved(LINE_MM))
    film(films / "moved.mp4", [frame(False), frame(True, shift_px=5.0)])
    bare = frame(False)
    bare[:300] = 90
    film(films / "hidden.mp4", [bare, bare])
    film(films / "short.mp4", [frame(False)])
    (films / "text.mp4").write_text("#EXTM3U\nframe.png\n")
    imported = import_videos(paths(tmp_path, names), films, markers(tmp_path), PLACE, "quill", tmp_path / "out")
    assert imported.rows == 1
    reasons = {names[0]: reason for reason, names in imported.refused.items()}
    assert reasons["moved"] == "the camera or the markers moved between its pictures"
    assert "sees 2 of 4 markers" in reasons["hidden"]
    assert reasons["short"] == "its video has fewer than two pictures"
    assert "is no MP4 video" in reasons["text"]
    assert reasons["missing"] == "there is no video of it"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "does not begin with the line marker,x_mm,y_mm,side_mm"),
        ("marker,x_mm,y_mm\n", "does not begin with the line"),
        ("marker,x_mm,y_mm,side_mm\n1,2,3\n", "line 2 is not a marker's number"),
        ("marker,x_mm,y_mm,side_mm\none,2,3,4\n", "line 2 is not a marker's number"),
        ("marker,x_mm,y_mm,side_mm\n1,0,0,5\n1,9,0,5\n2,0,9,5\n3,9,9,5\n", "needs four markers or more, all different"),
        ("marker,x_mm,y_mm,side_mm\n1,0,0,5\n2,9,0,5\n3,9,9,5\n", "needs four markers"),
        ("marker,x_mm,y_mm,side_mm\n1,0,0,5\n4,9,0,5\n2,0,9,5\n3,9,9,6\n", "with one side"),
    ],
)
def test_markers_that_do_not_fit_are_one_sentence(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "markers.csv"
    path.write_text(text)
    with pytest.raises(ContractError, match=said):
        read_markers(path, PLACE)


def test_options_that_do_not_fit_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = film(tmp_path / "films/s0.mp4", [frame(False), frame(True)])
    common = ["import", str(paths(tmp_path, ("s0", "s1"))), "--video", str(file), "--out", str(tmp_path / "out")]
    assert main([*common, "--tool", "quill"]) == 1
    assert "needs --markers, --window" in capsys.readouterr().err
    assert main([*common, "--tool", "quill", "--window", WINDOW, "--markers", str(markers(tmp_path))]) == 1
    assert "has 2 strokes, and" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_mirrored_pictures_are_refused() -> None:
    """Of a front camera, or a file that was flipped: some markers look like others in a mirror."""
    layout = MarkerLayout(tuple(MARKERS_MM), np.array(list(MARKERS_MM.values())) / 1000, SIDE_MM / 1000)
    window_m = np.array(PLACE.window_m((0, 0)))
    assert len(rectified([frame(True)], layout, window_m, one_camera=True)) == 1
    for axis in (0, 1):
        mirrored = np.ascontiguousarray(np.flip(frame(True), axis))
        with pytest.raises(Refused, match="cannot be registered"):
            rectified([mirrored], layout, window_m, one_camera=True)


def test_a_video_that_was_cut_off_is_refused(tmp_path: Path) -> None:
    """Of a camera that writes its index first, as for streaming: players show the beginning of such a file."""
    whole = film(tmp_path / "films/s0.mp4", [frame(False)] * 3 + [frame(True)] * 3)
    streamed = index_first(whole.read_bytes())
    whole.write_bytes(streamed)
    before, after = first_and_last(whole)
    assert np.abs(after.astype(int) - before).max() > 100
    for end in (len(streamed) - 1, len(streamed) * 3 // 4):
        whole.write_bytes(streamed[:end])
        with pytest.raises(Refused, match=r"s0\.mp4 is cut off"):
            first_and_last(whole)


def index_first(mp4: bytes) -> bytes:
    """The file with its box moov before mdat."""
    boxes, at = {}, 0
    while at < len(mp4):
        size = int.from_bytes(mp4[at : at + 4])
        boxes[mp4[at + 4 : at + 8]] = mp4[at : at + size]
        at += size
    index = bytearray(boxes[b"moov"])
    table = index.index(b"stco") + 8
    for entry in range(int.from_bytes(index[table : table + 4])):
        place = slice(table + 4 + 4 * entry, table + 8 + 4 * entry)
        index[place] = (int.from_bytes(index[place]) + len(index)).to_bytes(4)
    rest = b"".join(box for name, box in boxes.items() if name not in (b"ftyp", b"moov"))
    return boxes[b"ftyp"] + bytes(index) + rest
