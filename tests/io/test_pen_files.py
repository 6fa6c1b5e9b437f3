"""Tests of the import of pen strokes: SVG, demonstrations that the stage reads, and rows of strokes with a page."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from pentimento.cli.main import main
from pentimento.contracts.images import decode_png, read_image, write_png
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.handwriting.gather import Source, gather, read_source
from pentimento.handwriting.recording import standardise, to_source
from pentimento.handwriting.repair import Limits
from tests.io.pens import STROKES_MM, assert_places, demonstrations, inkml, saved, svg, traces, unipen
from tests.io.photographed import PIXELS_PER_MM, SHEET_MM, photograph, sheet

DOWN = np.array([1.0, -1.0])
FROM_TOP_MM = [stroke * DOWN + [0, SHEET_MM[1]] for stroke in STROKES_MM]
"""As on a page whose top left corner is the origin."""
CSS_PER_MM = 96 / 25.4
MM = '<traceFormat><channel name="X" units="mm"/><channel name="Y" units="mm"/>{}</traceFormat>'


def page() -> np.ndarray:
    drawn = sheet()
    for stroke in FROM_TOP_MM:
        pixels = np.round(stroke * PIXELS_PER_MM - 0.5).astype(np.int32)
        cv2.polylines(drawn, [pixels], False, (20, 20, 30), PIXELS_PER_MM)
    return drawn


@pytest.mark.parametrize(
    ("size", "per_mm", "options", "said"),
    [
        ('width="120mm" height="80mm" viewBox="0 0 120 80"', 1.0, (), None),
        ('width="120mm" height="80mm" viewBox="0 0 1200 800"', 10.0, (), None),
        ("", CSS_PER_MM, (), "1 px = 1/96 inch"),
        ('width="400" height="300px"', CSS_PER_MM, (), "1 px = 1/96 inch"),
        ('width="100%" height="100%" viewBox="0 0 500 500"', CSS_PER_MM, (), "1 px = 1/96 inch"),
        ('width="1000" height="600" viewBox="0 0 500 300"', CSS_PER_MM / 2, (), "1 px = 1/96 inch"),
        ("", 10.0, ("--units", "0.1 mm"), None),
    ],
)
def test_svg_is_read_at_its_size_or_at_96_pixels_an_inch(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    size: str,
    per_mm: float,
    options: tuple[str, ...],
    said: str | None,
) -> None:
    strokes = [np.round(stroke * per_mm, 6) for stroke in FROM_TOP_MM]
    text = "".join(f'<polyline points="{" ".join(f"{x:.6f},{y:.6f}" for x, y in each)}"/>' for each in strokes)
    path = saved(tmp_path / "a.svg", f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{text}</svg>')
    assert_places(demonstrations(path, *options), [stroke * DOWN for stroke in FROM_TOP_MM])
    printed = capsys.readouterr().out
    assert "y points down: flipped, as SVG defines it" in printed
    assert said in printed if said else "1/96" not in printed


def test_demonstrations_are_read_by_the_stage(tmp_path: Path) -> None:
    """A round trip: places, times and pressures, whatever the standard frame."""
    channels = MM.format('<channel name="T" units="s"/><channel name="F" units="%"/>')
    rows = [np.column_stack([s, 0.02 * np.arange(len(s)), 60 + np.arange(len(s))]) for s in STROKES_MM]
    demonstrations(inkml(tmp_path, channels + traces(rows)), "--y-up")
    source = Source(str(tmp_path / "demonstrations"), "demonstrations", "monday", "ben", None, None)
    found = read_source(source)
    assert_places([stroke.points for stroke in found], STROKES_MM)
    for stroke, row in zip(found, rows, strict=True):
        np.testing.assert_allclose(stroke.points[:, [0, 4]], row[:, 2:] * [1, 0.01], atol=1e-6)
    table = gather(found, Limits(5, 0.5, 8.0, 1e-3, 0.6), 16).table
    assert table["hand"].to_pylist() == ["ben"] * 2
    for row, stroke in zip(table.to_pylist(), found, strict=True):
        even = to_source(*standardise(stroke.points, 16))
        back = to_source(np.array(row["points"]), np.array(row["standard_to_source"]))
        np.testing.assert_allclose(back[:, 1:3], even[:, 1:3], atol=1e-6)


def files(folder: Path) -> list[Path]:
    """The strokes in three formats, each from the top left corner."""
    return [
        inkml(folder, MM.format("") + traces(FROM_TOP_MM)),
        unipen(folder, FROM_TOP_MM, "X Y", ".X_POINTS_PER_MM 1"),
        svg(folder, FROM_TOP_MM, 'width="120mm" viewBox="0 0 120 80"'),
    ]


@pytest.mark.parametrize("at", range(3), ids=["InkML", "UNIPEN", "SVG"])
def test_with_a_page_they_are_rows_of_strokes(tmp_path: Path, at: int) -> None:
    path, out = files(tmp_path)[at], tmp_path / "out"
    write_png(tmp_path / "page.png", page())
    command = ["import", str(path), "--page", str(tmp_path / "page.png"), "--scale", "5 px/mm", "--tool", "quill"]
    down = ["--y-down"] if path.suffix == ".unipen" else []
    assert main([*command, "--press", "0.5 mm", "--out", str(out), *down]) == 0
    rows = read_table(out, CONTRACT).table.to_pylist()
    assert_places([np.array(row["path"]) for row in rows], STROKES_MM)
    for row, stroke in zip(rows, STROKES_MM, strict=True):
        path_m = np.array(row["path"])
        np.testing.assert_allclose(path_m[:, 3], -0.5e-3, atol=1e-9)
        assert np.isnan(path_m[:, 0]).all() and row["tool"] == "quill"
        before, after = (decode_png(row[name]["bytes"]).astype(int) for name in ("before", "after"))
        x_min, _, _, y_max = row["window_m"]
        middle = np.round(([1, -1] * (1e-3 * stroke[1] - [x_min, y_max])) * 5000 - 0.5).astype(int)
        assert (after - before)[middle[1], middle[0]].max() < -150  # ink came, and where the path is
    sheet_of = read_image(out / "contact_sheet.png")
    assert sheet_of.shape[1] > 3 * 200 and (sheet_of != 255).any()


def test_pressures_become_depths_and_brushes_columns(tmp_path: Path) -> None:
    brush = '<brush xml:id="b"><brushProperty name="color" value="#102030"/></brush>'
    rows = [np.column_stack([stroke, np.linspace(0, 100, len(stroke))]) for stroke in FROM_TOP_MM]
    path = inkml(tmp_path, MM.format('<channel name="F" units="%"/>') + brush + traces(rows))
    write_png(tmp_path / "page.png", page())
    command = ["import", str(path), "--page", str(tmp_path / "page.png"), "--scale", "5 px/mm", "--tool", "quill"]
    assert main([*command, "--press", "2 mm", "--out", str(tmp_path / "out")]) == 0
    first, second = read_table(tmp_path / "out", CONTRACT).table.to_pylist()
    np.testing.assert_allclose(np.array(first["path"])[:, 3], np.linspace(0, -2e-3, len(first["path"])), atol=1e-9)
    np.testing.assert_allclose(second["color_srgb"], np.array([16, 32, 48]) / 255, atol=1e-6)
    assert second["tool_id"] == "b"


def test_photographs_are_named_by_the_strokes_number(tmp_path: Path) -> None:
    path = files(tmp_path)[0]
    for number, stroke in enumerate(STROKES_MM):
        photograph(tmp_path / "photos", str(number), stroke)
    command = ["import", str(path), "--photos", str(tmp_path / "photos"), "--scale", "5 px/mm", "--tool", "quill"]
    assert main([*command, "--press", "1 mm", "--out", str(tmp_path / "out")]) == 0
    assert_places(
        [np.array(row["path"]) for row in read_table(tmp_path / "out", CONTRACT).table.to_pylist()], STROKES_MM
    )


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ([], "which becomes demonstrations, needs --hand"),
        (["--hand", "ann", "--press", "1 mm"], "has no use for --press"),
        (["--page", "page.png", "--tool", "quill", "--press", "1 mm"], "needs --window or --scale"),
        (["--page", "page.png", "--tool", "quill", "--scale", "5 px/mm"], "no height of the tip; give --press"),
        (["--page", "page.png", "--tool", "q", "--scale", "5 px/mm", "--press", "deep"], "--press deep is no length"),
        (["--hand", "ann", "--units", "furlong"], "--units furlong is no unit of length"),
        (["--hand", "ann", "--units", "0 mm"], "--units 0 mm is not above zero"),
        (["--hand", "ann", "--video", "a.mp4"], "has no use for --video"),
    ],
)
def test_options_that_do_not_fit_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], said: str
) -> None:
    assert main(["import", str(files(tmp_path)[0]), "--out", str(tmp_path / "out"), *options]) == 1
    assert said in capsys.readouterr().err and not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["bad.svg", "bad.inkml", "bad.unipen"])
@pytest.mark.parametrize("content", [b"", b"\x00\xff\xfe", b"<svg", b"<svg><text>x</text></svg>", b".COORD"])
def test_a_malformed_file_ends_in_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, content: bytes
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    assert main(["import", str(path), "--hand", "ann", "--out", str(tmp_path / "out")]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("pentimento: ") and str(path) in line
    assert list(tmp_path.iterdir()) == [path]


def test_a_unit_that_cannot_be_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = unipen(tmp_path, [1e3 * stroke for stroke in STROKES_MM], "X Y", "")
    assert main(["import", str(path), "--hand", "ann", "--units", "m", "--out", str(tmp_path / "out")]) == 1
    assert "more than 100 m from its origin; check its unit of length." in capsys.readouterr().err


def test_strokes_that_no_person_draws_and_dots_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    timed = [np.column_stack([stroke, 20.0 * np.arange(len(stroke))]) for stroke in FROM_TOP_MM]
    slow = inkml(tmp_path, MM.format('<channel name="T" units="s"/>') + traces(timed))
    assert main(["import", str(slow), "--hand", "ann", "--out", str(tmp_path / "out")]) == 1
    assert "as no person draws" in capsys.readouterr().err
    dotted = inkml(tmp_path, MM.format("") + traces([FROM_TOP_MM[0], FROM_TOP_MM[0][:1]]))
    assert main(["import", str(dotted), "--hand", "ann", "--out", str(tmp_path / "out")]) == 0
    assert "Refused: 1 × it stays at one place (1)." in capsys.readouterr().out


def test_implausible_times_are_refused_with_pictures_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Seconds in a channel without a unit, which usually holds milliseconds."""
    text = MM.format('<channel name="T"/>') + "<trace>10 10 0.0,20 20 0.5</trace>"
    photographs = ("--photos", str(tmp_path), "--scale", "5 px/mm", "--tool", "pen", "--press", "1 mm")
    given = ["import", str(inkml(tmp_path, text)), *photographs, "--out", str(tmp_path / "out")]
    assert main(given) == 1
    assert "as no person draws; see that times are in seconds" in capsys.readouterr().err
