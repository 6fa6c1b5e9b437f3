import io
from dataclasses import replace

import numpy as np
import PIL.Image
import pytest

from pentimento.contracts.plan import Plan, PlannedStroke
from pentimento.report.figures import (
    BLUE,
    Series,
    difference,
    difference_maps,
    line_chart,
    resized,
    shared_top,
    stroke_lines,
    time_lapse,
)
from pentimento.report.paintings import PaintingInputs


def pixels(png: bytes) -> np.ndarray:
    return np.asarray(PIL.Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def test_equal_data_give_equal_bytes_without_metadata() -> None:
    one = line_chart([Series("loss", [0, 1, 2], [3.0, 2.0, 1.0], BLUE)], "epoch", "loss", (3, 2))
    assert one == line_chart([Series("loss", [0, 1, 2], [3.0, 2.0, 1.0], BLUE)], "epoch", "loss", (3, 2))
    assert b"tEXt" not in one and b"matplotlib" not in one.lower()


def test_scales_are_shared_and_rounded_up() -> None:
    assert shared_top([np.full((4, 4), 0.11), np.full((4, 4), 0.32)]) == pytest.approx(0.35)
    assert shared_top([np.zeros((4, 4))]) == pytest.approx(0.05)


def test_larger_difference_is_darker() -> None:
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


def solid(level: int, shape: tuple[int, int] = (4, 6)) -> np.ndarray:
    return np.full((*shape, 3), level, dtype=np.uint8)


def test_difference_is_the_root_mean_square_over_channels() -> None:
    other = solid(0)
    other[0, 0] = (255, 0, 0)
    found = difference(solid(0), other)
    assert found[0, 0] == pytest.approx(np.sqrt(1 / 3)) and found[1:].max() == 0


def test_mean_squared_difference_is_the_mse() -> None:
    one, other = (np.random.default_rng(seed).integers(0, 256, (4, 6, 3), dtype=np.uint8) for seed in (0, 1))
    mse = np.square(one / 255 - other / 255).mean()
    assert np.square(difference(one, other)).mean() == pytest.approx(mse, rel=1e-5)


def test_photograph_of_higher_resolution_is_averaged_in_linear_light() -> None:
    stripes = solid(0, (8, 12))
    stripes[::2] = 255
    assert resized(stripes, (4, 6, 3)) == pytest.approx(np.full((4, 6, 3), 0.7354), abs=1e-3)  # sRGB of half the light


def test_time_lapse_has_every_frame_and_holds_the_last() -> None:
    frames = [solid(level) for level in (250, 120, 10)]
    data = time_lapse(frames, 300)
    assert data == time_lapse(frames, 300)
    with PIL.Image.open(io.BytesIO(data)) as lapse:
        assert lapse.n_frames == 3 and lapse.info["loop"] == 0
        for number, level in enumerate((250, 120, 10)):
            lapse.seek(number)
            assert abs(int(np.asarray(lapse.convert("RGB")).mean()) - level) <= 4
            assert lapse.info["duration"] == (300 if number < 2 else 3600)
