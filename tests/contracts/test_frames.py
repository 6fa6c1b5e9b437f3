import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from pentimento.contracts.errors import ContractError
from pentimento.contracts.frames import (
    canvas_to_pixel,
    canvas_to_stroke,
    coarsening,
    crop,
    image_shape,
    pixel_to_canvas,
    pixels_per_m,
    snap_window,
    stroke_to_canvas,
    window_around,
)

WINDOW = (0.1, 0.2, 0.4, 0.4)
coordinates = st.floats(-1.0, 1.0)


def test_centre_of_pixel_row_column_is_column_row() -> None:
    # Design section 3: x = x_min + (c + 1/2) / k, y = y_max - (r + 1/2) / k.
    k, row, column = 1000.0, 7, 30
    x, y = 0.1 + (column + 0.5) / k, 0.4 - (row + 0.5) / k
    assert_allclose(canvas_to_pixel([x, y], WINDOW, k), [column, row], atol=1e-9)


def test_corners_of_the_window_are_the_edges_of_the_image() -> None:
    height, width = image_shape(WINDOW, 1000.0)
    assert (height, width) == (200, 300)
    corners = canvas_to_pixel([[0.1, 0.4], [0.4, 0.2]], WINDOW, 1000.0)
    assert_allclose(corners, [[-0.5, -0.5], [width - 0.5, height - 0.5]], atol=1e-9)


@given(coordinates, coordinates, st.floats(10, 1e4))
def test_pixels_and_canvas_are_inverse(x: float, y: float, k: float) -> None:
    assert_allclose(pixel_to_canvas(canvas_to_pixel([[x, y]], WINDOW, k), WINDOW, k), [[x, y]], atol=1e-9)


@given(coordinates, coordinates, st.floats(-7, 7))
def test_stroke_and_canvas_are_inverse_and_rigid(x: float, y: float, theta: float) -> None:
    points = np.random.default_rng(0).normal(size=(5, 4))
    moved = stroke_to_canvas(points, x, y, theta)
    assert_allclose(canvas_to_stroke(moved, x, y, theta), points, atol=1e-12)
    assert_array_equal(moved[:, 2:], points[:, 2:])
    assert_allclose(
        np.linalg.norm(np.diff(moved[:, :2], axis=0), axis=1),
        np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1),
    )


def test_stroke_frame_has_its_x_along_theta() -> None:
    start_and_ahead = np.array([[0.0, 0.0], [0.05, 0.0]])
    assert_allclose(stroke_to_canvas(start_and_ahead, 0.2, 0.1, math.pi / 2), [[0.2, 0.1], [0.2, 0.15]], atol=1e-15)


def test_stroke_to_canvas_leaves_its_argument_alone() -> None:
    points = np.zeros((2, 3))
    stroke_to_canvas(points, 1.0, 1.0, 0.0)
    assert not points.any()


def test_pixels_per_m_of_an_image_rounded_to_whole_pixels() -> None:
    window = (0.0, 0.0, 0.0305, 0.0203)
    assert pixels_per_m(image_shape(window, 1234.0), window) == pytest.approx(1234.0, rel=0.02)


def test_pixels_that_are_not_square_are_refused() -> None:
    with pytest.raises(ContractError, match="pixels must be square"):
        pixels_per_m((224, 330), (-0.012, -0.028, 0.068, 0.028))


def test_crop_is_the_image_of_the_smaller_window() -> None:
    k = 100.0
    height, width = image_shape(WINDOW, k)
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    places = pixel_to_canvas(np.stack([columns, rows], -1), WINDOW, k)  # each pixel holds its own place
    part = (0.15, 0.25, 0.22, 0.37)
    inner = crop(places, WINDOW, part)
    assert inner.shape[:2] == image_shape(part, k)
    assert_allclose(inner[0, 0], pixel_to_canvas([0, 0], part, k))
    assert_allclose(inner[-1, -1], pixel_to_canvas(np.array(inner.shape[1::-1]) - 1, part, k))


def test_crop_survives_float32_windows() -> None:
    image = np.zeros((800, 1200, 3), np.uint8)
    part = np.array([0.10025, 0.05075, 0.15, 0.1], np.float32)
    assert crop(image, (0, 0, 0.3, 0.2), part).shape == (197, 199, 3)


@given(st.tuples(coordinates, coordinates), st.floats(0.011, 0.1), st.floats(90, 110))
def test_a_snapped_window_can_be_cropped_and_contains_the_window(
    corner: tuple[float, float], size: float, k: float
) -> None:
    x, y = 0.1 + 0.1 * (1 + corner[0]), 0.2 + 0.05 * (1 + corner[1])
    window = (x, y, x + size, y + size)
    image = np.zeros(image_shape(WINDOW, k))
    snapped = snap_window(window, WINDOW, image.shape)
    assert min(crop(image, WINDOW, snapped).shape) >= 1
    tolerance = 1.1 * 0.01 / k  # what counts as aligned
    assert (snapped[:2] <= np.array(window[:2]) + tolerance).all()
    assert (snapped[2:] >= np.minimum(window[2:], WINDOW[2:]) - tolerance).all()
    assert (np.abs(snapped - window)[:2] < 1.1 / k).all()


@pytest.mark.parametrize(
    ("part", "says"),
    [((0.1505, 0.25, 0.2, 0.3), "not aligned"), ((0.35, 0.25, 0.45, 0.3), "reaches beyond")],
)
def test_crop_refuses_what_it_would_have_to_resample(part: tuple[float, ...], says: str) -> None:
    with pytest.raises(ContractError, match=says):
        crop(np.zeros((20, 30)), WINDOW, part)


def test_snap_window_needs_an_overlap() -> None:
    with pytest.raises(ContractError, match="does not overlap"):
        snap_window((0.5, 0.5, 0.6, 0.6), WINDOW, (20, 30))


def test_window_around_a_path() -> None:
    path = np.array([[0, 0.1, 0.1, 9, 9], [1, 0.2, 0.05, -9, 9]])
    assert_allclose(window_around(path, 0.01), [0.09, 0.04, 0.21, 0.11])
    with pytest.raises(ContractError, match="empty or has a NaN"):
        window_around(np.full((2, 5), np.nan), 0.01)


@pytest.mark.parametrize("window", [(0, 0, 0, 1), (0, 1, 1, 0), (0, 0, np.nan, 1), (0, 0, 1)])
def test_bad_windows_are_refused(window: tuple[float, ...]) -> None:
    with pytest.raises(ContractError, match="Window"):
        image_shape(window, 100.0)


def test_a_window_below_one_pixel_hints_at_units() -> None:
    with pytest.raises(ContractError, match="millimetres"):
        image_shape((0.0, 0.0, 0.0003, 0.0002), 1000.0)


def test_images_of_one_scale_are_averaged_by_one_factor() -> None:
    noisy = 960 * (1 + 1e-6 * np.array([-1, 1, 0, -0.5]))
    assert coarsening(noisy, 640).tolist() == [2, 2, 2, 2]
    assert coarsening([500, np.nan, 1000, 1004, 250], 250).tolist() == [2, 1, 4, 4, 1]
    assert coarsening([500, 300], np.inf).tolist() == [1, 1]
    assert coarsening([], 100).tolist() == []
