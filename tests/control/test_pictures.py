"""The picture of the next strokes."""

import numpy as np
import pytest

from pentimento.contracts.plan import PlannedStroke
from pentimento.control.pictures import draw_strokes

CANVAS = np.full((40, 60, 3), 200, np.uint8)
SIZE_M = (0.06, 0.04)


def _stroke(start: tuple[float, float], end: tuple[float, float]) -> PlannedStroke:
    path = np.array([[0, *start, -0.001, 0], [1, *end, -0.001, 0]])
    return PlannedStroke(path, np.zeros(3), dip=False)


def test_draw_strokes_without_strokes_is_the_paler_canvas() -> None:
    picture = draw_strokes(CANVAS, [], SIZE_M)
    assert picture.shape == (120, 180, 3) and np.all(picture == 227)


@pytest.mark.parametrize(("start", "end"), [((0.01, 0.01), (0.05, 0.01)), ((0.05, 0.03), (0.02, 0.02))])
def test_draw_strokes_draws_line_and_start(start: tuple[float, float], end: tuple[float, float]) -> None:
    picture = draw_strokes(CANVAS, [_stroke(start, end)], SIZE_M).astype(int)
    for share in (0.3, 0.6, 0.98):
        x_m, y_m = (1 - share) * np.array(start) + share * np.array(end)
        column, row = x_m / 0.06 * 180 - 0.5, (0.04 - y_m) / 0.04 * 120 - 0.5
        red, green, blue = picture[round(row), round(column)]
        assert red > green + 50 and red > blue + 50
    column, row = start[0] / 0.06 * 180 - 0.5, (0.04 - start[1]) / 0.04 * 120 - 0.5
    assert picture[round(row), round(column), 2] > picture[round(row), round(column), 0] + 50
    changed = np.abs(picture - 227).max(axis=2) > 20
    assert changed.mean() < 0.05
