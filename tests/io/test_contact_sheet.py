"""Tests of the contact sheet: paths lie where they were drawn."""

import cv2
import numpy as np
import pyarrow as pa
import pytest

from pentimento.contracts.images import encode_png
from pentimento.contracts.strokes import example_table
from pentimento.io.contact_sheet import SHOWN, Shown, contact_sheet, shown_paths, shown_strokes

WINDOW = np.array([0.0, 0.0, 0.02, 0.02])


def coloured(sheet: np.ndarray, channel: int) -> np.ndarray:
    """Where one channel is far above another one: the start is green, the line red."""
    other = (channel + 1) % 2
    return np.argwhere(sheet[..., channel].astype(int) - sheet[..., other] > 80)


@pytest.mark.parametrize(("end", "right", "up"), [((0.018, 0.01), 1, 0), ((0.01, 0.018), 0, 1), ((0.002, 0.01), -1, 0)])
def test_a_path_starts_at_its_dot_and_y_is_up(end: tuple[float, float], right: int, up: int) -> None:
    sheet = contact_sheet([Shown(np.array([[0.01, 0.01], end]), WINDOW, None)])
    start, line = coloured(sheet, 1).mean(0), coloured(sheet, 0)
    cell = sheet.shape[1] / 3
    np.testing.assert_allclose(start, [cell / 2, cell / 2], atol=4)
    across, down = line.mean(0)[1] - start[1], line.mean(0)[0] - start[0]
    assert np.sign([across, -down])[np.abs([right, up]) == 1] == right + up
    assert max(abs(across), abs(down)) == pytest.approx(0.2 * cell, rel=0.15)


def test_the_picture_is_below_the_path() -> None:
    picture = np.full((100, 100, 3), 240, np.uint8)
    cv2.line(picture, (10, 49), (90, 49), (20, 20, 20), 9)
    sheet = contact_sheet([Shown(np.array([[0.002, 0.01], [0.018, 0.01]]), WINDOW, picture)])
    line = coloured(sheet, 0)
    assert len(line) and all((sheet[row - 4, column] < 60).all() for row, column in line[::9])


def test_a_sheet_has_nine_rows_at_most_and_any_encoding() -> None:
    table = example_table(12)
    cells = shown_strokes(table)
    assert len(cells) == SHOWN
    whole = contact_sheet(cells)
    assert whole.shape[0] == whole.shape[1]
    row = table.slice(0, 1).to_pylist()[0] | {"encoding": "ink"}
    row["after"] = {"bytes": encode_png(np.full((56, 80), 200, np.uint8)), "path": None}
    (grey,) = shown_strokes(pa.Table.from_pylist([row], schema=table.schema))
    assert grey.picture is not None and grey.picture.shape == (56, 80, 3)
    assert contact_sheet([grey]).shape[0] == whole.shape[0] // 3


def test_paths_without_pictures_fill_their_cells() -> None:
    small, large = (scale * np.array([[0.0, 0.0], [1.0, 0.5]]) for scale in (1e-3, 0.2))
    for path, cell in zip((small, large), shown_paths([small, large]), strict=True):
        assert cell.window_m[2] - cell.window_m[0] == pytest.approx(1.3 * np.ptp(path[:, 0]))
        assert (cell.window_m[:2] < path.min(0)).all() and (cell.window_m[2:] > path.max(0)).all()
    dot = shown_paths([np.zeros((2, 2))])
    assert contact_sheet(dot).shape[2] == 3
