"""Checks of photographs, as pure functions of pictures, and the camera that applies them."""

import numpy as np
import pytest

from pentimento.calibration.observe import calibrate_camera
from pentimento.contracts.markers import markers_around
from pentimento.control.camera import (
    Camera,
    PaintingFault,
    is_blank,
    is_frozen,
    marker_shift_m,
    sheet_shift_m,
    stroke_mask,
    unexplained_share,
    visible_mark,
    visible_share,
)
from tests.bundle.line_brush import sheet
from tests.control.faulty import FaultyRobot, black, shifted

SIZE_M = (0.1, 0.08)
SHAPE = (160, 200)
PATH = np.array([[0, 0.02, 0.02, -0.001, 0], [1, 0.08, 0.06, -0.001, 0]])


def _paper(seed: int) -> np.ndarray:
    return (230 + np.random.default_rng(seed).normal(0, 1.5, (*SHAPE, 3))).astype(np.uint8)


def test_unexplained_share_ignores_noise_and_lighting() -> None:
    nothing = np.zeros(SHAPE, bool)
    brighter = (_paper(2).astype(float) * 1.05).clip(0, 255).astype(np.uint8)
    assert unexplained_share(_paper(0), _paper(1), nothing, SIZE_M) == 0
    assert unexplained_share(_paper(0), brighter, nothing, SIZE_M) == 0


def test_unexplained_share_ignores_strokes_and_counts_the_rest() -> None:
    now = _paper(1)
    explained = stroke_mask([PATH], 0.002, SHAPE, SIZE_M)
    now[explained] = 30
    assert unexplained_share(_paper(0), now, explained, SIZE_M) == 0
    now[:40, :50] = 120  # a sixteenth of the canvas
    assert unexplained_share(_paper(0), now, explained, SIZE_M) == pytest.approx(1 / 16, rel=0.25)


@pytest.mark.parametrize("by_px", [(0, 6), (5, 0), (4, -7)])
def test_sheet_shift_measures_a_slide_and_rejects_a_hand(by_px: tuple[int, int]) -> None:
    rng = np.random.default_rng(5)
    drawn = np.full((*SHAPE, 3), 230, np.uint8)
    for _ in range(12):
        row, column = rng.integers(20, 120), rng.integers(20, 150)
        drawn[row : row + 3, column : column + 30] = 40
    nothing, per_m = np.zeros(SHAPE, bool), SHAPE[1] / SIZE_M[0]
    found = sheet_shift_m(drawn, np.roll(drawn, by_px, axis=(0, 1)), nothing, per_m)
    assert found == pytest.approx(np.hypot(*by_px) / per_m, rel=0.1)
    hand = drawn.copy()
    hand[40:120, 60:140] = 150
    assert sheet_shift_m(drawn, hand, nothing, per_m) is None


def test_blank_and_frozen_frames_are_detected() -> None:
    robot = sheet()
    one, other = robot.photo(), robot.photo()
    assert not is_blank(one) and is_blank(black(one))
    assert not is_frozen(other, one) and is_frozen(one, one) and not is_frozen(one, None)


def test_marker_shift_measures_a_moved_camera() -> None:
    robot = sheet()
    photo, layout = robot.photo(), markers_around(robot.canvas_size_m)
    calibration = calibrate_camera(photo, layout)
    still, moved = (marker_shift_m(p, calibration, layout) for p in (robot.photo(), shifted(photo)))
    assert still is not None and still < 2e-4
    per_m = np.linalg.norm(np.diff(calibration.to_camera(np.array([[0.0, 0.05], [0.1, 0.05]])), axis=0)) / 0.1
    assert moved == pytest.approx(np.hypot(12, 5) / per_m, rel=0.1)
    assert marker_shift_m(black(photo), calibration, layout) is None


def encode(light: np.ndarray) -> np.ndarray:
    return (255 * (1.055 * light ** (1 / 2.4) - 0.055)).round().astype(np.uint8)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0, 1.3])
def test_visible_share_measures_a_partial_change(share: float) -> None:
    light = np.full((40, 40, 3), 0.8, np.float32)
    meant = light.copy()
    meant[10:20, 5:30] = 0.3
    assert visible_share(encode(light), encode(light + share * (meant - light)), meant) == pytest.approx(
        share, abs=0.02
    )


def test_light_paint_that_vanishes_in_dark_paint_tells_nothing_of_the_tool() -> None:
    dark, light = np.full((40, 40, 3), 0.1, np.float32), np.full((40, 40, 3), 0.1, np.float32)
    light[10:20] = 0.9
    assert visible_share(encode(dark), encode(dark), light) == pytest.approx(0, abs=0.01)
    assert visible_mark(encode(dark), encode(dark), light, pixels=1) is None
    assert visible_mark(encode(light), encode(light), dark, pixels=400) == pytest.approx(0, abs=0.01)  # a dry tool
    assert visible_mark(encode(light), encode(dark), dark, pixels=400) == pytest.approx(1, abs=0.02)
    assert visible_mark(encode(light), encode(light), dark, pixels=401) is None


def test_visible_share_of_an_invisible_change_is_none() -> None:
    light = np.full((40, 40, 3), 0.8, np.float32)
    picture = np.full((40, 40, 3), 231, np.uint8)
    assert visible_share(picture, picture, light) is None


def test_camera_refuses_a_canvas_moved_since_calibration() -> None:
    robot = FaultyRobot(sheet())
    calibration = calibrate_camera(robot.photo(), markers_around(robot.canvas_size_m))
    assert Camera(robot, (0.1, 0.1), 600.0, calibrated=calibration).observe().picture.shape == (60, 60, 3)
    robot.on_photo = shifted
    with pytest.raises(PaintingFault, match="since it was calibrated"):
        Camera(robot, (0.1, 0.1), 600.0, calibrated=calibration)
    assert Camera(robot, (0.1, 0.1), 600.0).observe().picture.shape == (60, 60, 3)  # without a calibration
