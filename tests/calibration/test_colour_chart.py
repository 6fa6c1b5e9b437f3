"""The colour map: recovered where a camera is linear, honest where it is not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pentimento.calibration.colour_chart import PATCHES_SRGB, chart_image, find_colours, patch_means, true_colours
from pentimento.contracts.colour import (
    delta_e_2000,
    linear_to_srgb,
    srgb_to_lab,
    srgb_to_linear,
    to_float,
    to_uint8,
)
from pentimento.contracts.errors import CalibrationError

PROPERTY = settings(max_examples=40, deadline=None, derandomize=True, database=None)


def seen_by(image: np.ndarray, matrix: np.ndarray, offset: np.ndarray) -> np.ndarray:
    linear = srgb_to_linear(to_float(image).astype(np.float64)) @ matrix.T + offset
    return to_uint8(linear_to_srgb(np.clip(linear, 0, 1)))


def test_the_chart_holds_its_patches() -> None:
    assert linear_to_srgb(patch_means(chart_image(20))) == pytest.approx(PATCHES_SRGB, abs=0.51 / 255)
    neighbours = np.abs(np.diff(PATCHES_SRGB, axis=0)).max(axis=1)
    assert neighbours.min() > 0.05


@PROPERTY
@given(seed=st.integers(0, 2**31))
def test_a_linear_camera_is_inverted(seed: int) -> None:
    """Cross-talk, white balance, exposure and stray light; colours that are not on the chart come back, too."""
    rng = np.random.default_rng(seed)
    matrix = np.diag(rng.uniform(0.6, 0.95, 3)) @ (np.eye(3) + rng.uniform(-0.05, 0.05, (3, 3)))
    offset = rng.uniform(0.0, 0.02, 3)
    found = find_colours(seen_by(chart_image(16), matrix, offset))
    assert found.matrix == pytest.approx(np.linalg.inv(matrix), abs=0.03)
    assert found.residual < 0.5
    colours = to_uint8(rng.uniform(0.2, 0.8, (40, 1, 3)))
    back = true_colours(seen_by(colours, matrix, offset), found)
    errors = delta_e_2000(srgb_to_lab(to_float(back)), srgb_to_lab(to_float(colours)))
    assert errors.mean() < 1.0


def test_colour_map_of_a_perfect_camera_is_the_identity() -> None:
    found = find_colours(chart_image(16))
    assert found.matrix == pytest.approx(np.eye(3), abs=0.01) and found.offset == pytest.approx(np.zeros(3), abs=2e-3)


def test_a_chart_the_wrong_way_round_is_noticed() -> None:
    chart = chart_image(16)
    try:
        found = find_colours(chart[::-1, ::-1])
    except CalibrationError as error:
        assert "upright" in str(error)
    else:
        assert found.residual > 10


def test_a_burnt_out_chart_is_refused() -> None:
    with pytest.raises(CalibrationError, match="burnt out"):
        find_colours(seen_by(chart_image(16), 9 * np.eye(3), np.zeros(3)))
    with pytest.raises(CalibrationError, match="burnt out"):
        find_colours(np.zeros((60, 60, 3), np.uint8))


def test_nonlinear_camera_increases_the_colour_residual() -> None:
    bent = to_uint8(to_float(chart_image(16)) ** 1.6)
    assert find_colours(bent).residual > 2
