"""Tests of the import of paths in a CSV file with one picture of the page that shows all strokes."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pentimento.cli.main import main
from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import decode_png, write_png
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.io.scanned_page import import_page
from pentimento.io.stroke_rows import Placement
from tests.io.photographed import PIXELS_PER_MM, SHEET_MM, sheet, written

WINDOW = "0 mm, 0 mm, 120 mm, 80 mm"
PLACE = Placement.parsed(WINDOW, None, False)
LINES_MM = {
    "across": ((20.0, 40.0), (60.0, 40.0)),
    "down": ((40.0, 55.0), (40.0, 25.0)),  # crosses it
    "beside": ((20.0, 36.0), (34.0, 36.0)),  # 4 mm from the first
}
HALF_MM = 0.6


def page(lines: dict[str, tuple[tuple[float, float], ...]] = LINES_MM) -> NDArray[np.uint8]:
    """The sheet with dark lines, 1.2 mm wide, along the paths (y up)."""
    drawn = sheet()
    for line in lines.values():
        pixels = np.array(line) * [1, -1] * PIXELS_PER_MM + [-0.5, SHEET_MM[1] * PIXELS_PER_MM - 0.5]
        cv2.polylines(
            drawn, [np.round(pixels).astype(np.int32)], False, (20, 20, 30), round(2 * HALF_MM * PIXELS_PER_MM)
        )
    return drawn


def paths(folder: Path, lines: dict[str, tuple[tuple[float, float], ...]] = LINES_MM) -> Path:
    rows = [f"{name},{at},{x},{y},-1" for name, line in lines.items() for at, (x, y) in enumerate(line)]
    return written(folder, ["stroke,t_s,x_mm,y_mm,z_mm", *rows])


def rows_of(folder: Path, picture: NDArray[np.uint8], blank: NDArray[np.uint8] | None = None) -> list[dict]:
    write_png(folder / "page.png", picture)
    bare = None
    if blank is not None:
        write_png(bare := folder / "blank.png", blank)
    imported = import_page(paths(folder), folder / "page.png", bare, PLACE, "quill", folder / "out")
    assert imported.rows == len(LINES_MM) and not imported.refused
    return read_table(folder / "out", CONTRACT).table.to_pylist()


def pictures(row: dict) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
    before, after = (decode_png(row[name]["bytes"]).astype(np.int16) for name in ("before", "after"))
    return before, after


def distances_mm(row: dict) -> NDArray[np.float64]:
    """Distance of each pixel of a row's window from the segment of its path."""
    height, width = pictures(row)[0].shape[:2]
    x_min, _, _, y_max = np.array(row["window_m"]) * 1e3
    x = x_min + (np.arange(width) + 0.5) / PIXELS_PER_MM
    y = y_max - (np.arange(height)[:, None] + 0.5) / PIXELS_PER_MM
    (x0, y0), (x1, y1) = np.array(row["path"])[[0, -1], 1:3] * 1e3
    along = np.clip(((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / ((x1 - x0) ** 2 + (y1 - y0) ** 2), 0, 1)
    return np.hypot(x - x0 - along * (x1 - x0), y - y0 - along * (y1 - y0))


@pytest.mark.parametrize("blank", [None, sheet()], ids=["no blank page", "blank page"])
def test_each_row_shows_its_own_stroke_in_its_own_window(tmp_path: Path, blank: NDArray[np.uint8] | None) -> None:
    rows = rows_of(tmp_path, page(), blank)
    for row in rows:
        before, after = pictures(row)
        changed = np.abs(after - before).sum(-1) > 100
        near = distances_mm(row)
        assert near[changed].max() < HALF_MM + 0.4
        assert changed[near < 0.3].mean() > 0.9  # but where it crosses another stroke
        height, width = before.shape[:2]
        size = np.ptp(np.array(row["path"])[:, 1:3], axis=0) * 1e3
        assert np.all(np.array([width, height]) / PIXELS_PER_MM < size + 6)  # not the page of 120 x 80 mm


def test_strokes_appear_in_their_order(tmp_path: Path) -> None:
    across, down, _ = (pictures(row) for row in rows_of(tmp_path, page(), sheet()))
    assert (across[0] == 240).all()
    dark = (down[0] < 100).all(-1)
    band = dark.any(1).sum() * dark.shape[1]
    assert 0.8 * band < dark.sum() < band  # the first stroke, but for the pixels that are nearer to the second
    then = (down[1] < 100).all(-1)
    assert (then >= dark).all() and then[dark.any(1)].all() and then.sum() > 5 * dark.sum()


def test_given_order_counts(tmp_path: Path) -> None:
    turned = dict(reversed(LINES_MM.items()))
    write_png(tmp_path / "page.png", page())
    rows = [
        f"{name},{at},{x},{y},-1,{list(LINES_MM).index(name)}"
        for name, line in turned.items()
        for at, (x, y) in enumerate(line)
    ]
    given = written(tmp_path, ["stroke,t_s,x_mm,y_mm,z_mm,order", *rows])
    import_page(given, tmp_path / "page.png", None, PLACE, "quill", tmp_path / "turned")
    found = {row["order"]: row for row in read_table(tmp_path / "turned", CONTRACT).table.to_pylist()}
    for order, row in enumerate(rows_of(tmp_path, page())):
        assert row["before"] == found[order]["before"] and row["after"] == found[order]["after"]


def test_page_of_other_paths_is_refused(tmp_path: Path) -> None:
    for name, picture in (("bare", sheet()), ("moved", np.roll(page(), (150, 150), (0, 1)))):
        write_png(tmp_path / f"{name}.png", picture)
        with pytest.raises(ContractError, match="shows no ink along the paths"):
            import_page(paths(tmp_path), tmp_path / f"{name}.png", None, PLACE, "quill", tmp_path / "out")
    write_png(tmp_path / "page.png", page())
    write_png(tmp_path / "small.png", sheet()[:-5])
    with pytest.raises(ContractError, match="differ in size"):
        import_page(paths(tmp_path), tmp_path / "page.png", tmp_path / "small.png", PLACE, "quill", tmp_path / "out")
    with pytest.raises(ContractError, match=r"nowhere\.png is not a readable picture"):
        import_page(paths(tmp_path), tmp_path / "nowhere.png", None, PLACE, "quill", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_path_over_another_and_one_off_the_page_are_counted(tmp_path: Path) -> None:
    lines = LINES_MM | {"again": LINES_MM["across"], "off": ((20.0, 40.0), (300.0, 40.0))}
    write_png(tmp_path / "page.png", page())
    imported = import_page(paths(tmp_path, lines), tmp_path / "page.png", None, PLACE, "quill", tmp_path / "out")
    assert imported.rows == 3
    assert imported.refused == {
        "other paths are as near as its own to all of its ink": ["again"],
        "its path leaves the photograph": ["off"],
    }


def test_no_path_on_the_page_is_one_sentence(tmp_path: Path) -> None:
    write_png(tmp_path / "page.png", page())
    off = paths(tmp_path, {"off": ((20.0, 40.0), (300.0, 40.0))})
    with pytest.raises(ContractError, match=r"None of the 1 strokes .*its path leaves the photograph"):
        import_page(off, tmp_path / "page.png", None, PLACE, "quill", tmp_path / "out")


def test_command_takes_a_page_in_place_of_photographs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_png(tmp_path / "page.png", page())
    common = ["import", str(paths(tmp_path)), "--window", WINDOW, "--tool", "quill", "--out", str(tmp_path / "out")]
    assert main([*common, "--page", str(tmp_path / "page.png")]) == 0
    assert "3 strokes are in" in capsys.readouterr().out
    assert main([*common, "--photos", str(tmp_path), "--blank", str(tmp_path / "page.png")]) == 1
    assert "has no use for --blank" in capsys.readouterr().err
