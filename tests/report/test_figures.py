import io
from dataclasses import replace

import numpy as np
import PIL.Image
import pytest

from pentimento.contracts.plan import Plan, PlannedStroke
from pentimento.report.figures import BLUE, Series, difference_maps, line_chart, shared_top, stroke_lines
from pentimento.report.inputs import PaintingInputs


def pixels(png: bytes) -> np.ndarray:
    return np.asarray(PIL.Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def test_equal_data_give_equal_bytes_without_metadata() -> None:
    one = line_chart([Series("loss", [0, 1, 2], [3.0, 2.0, 1.0], BLUE)], "epoch", "loss", (3, 2))
    assert one == line_chart([Series("loss", [0, 1, 2], [3.0, 2.0, 1.0], BLUE)], "epoch", "loss", (3, 2))
    assert b"tEXt" not in one and b"matplotlib" not in one.lower()


def test_scales_are_shared_and_rounded_up() -> None:
    assert shared_top([np.full((4, 4), 0.11), np.full((4, 4), 0.32)]) == pytest.approx(0.35)
    assert shared_top([np.zeros((4, 4))]) == pytest.approx(0.05)


def test_a_larger_difference_is_darker() -> None:
    picture = pixels(difference_maps({"a": np.zeros((20, 30)), "b": np.full((20, 30), 0.5)}, "difference"))
    middle = picture.shape[0] // 2
    left, right = picture[middle, picture.shape[1] // 5], picture[middle, 3 * picture.shape[1] // 5]
    assert left.sum() > 700 and right.sum() < left.sum() - 200


def test_strokes_are_drawn_with_x_to_the_right_and_y_up(painting: PaintingInputs) -> None:
    """A red stroke in the canvas's upper left corner comes out there in the left panel."""
    path = np.array([[0.0, 0.005, 0.036, -0.001, 0.0], [0.5, 0.015, 0.036, -0.001, 0.0]])
    stroke = PlannedStroke(path, np.array([1.0, 0.0, 0.0]), True)
    plan = Plan(replace(painting.executed.header), (stroke,))
    picture = pixels(stroke_lines(plan))
    panel = np.abs(picture - (0xCF, 0xCF, 0xCA)).max(-1) <= 2  # the left panel's ground
    rows = np.nonzero(panel.sum(1) > 100)[0]  # not the ends of grey letters
    columns = np.nonzero(panel.sum(0) > 100)[0]
    red = np.argwhere((picture[..., 0] > 200) & (picture[..., 1] < 60) & (picture[..., 2] < 60))
    row, column = red.mean(0)
    down = (row - rows.min()) / (rows.max() - rows.min())
    along = (column - columns.min()) / (columns.max() - columns.min())
    assert down == pytest.approx(1 - 0.036 / 0.04, abs=0.03)
    assert along == pytest.approx(0.010 / 0.06, abs=0.03)
