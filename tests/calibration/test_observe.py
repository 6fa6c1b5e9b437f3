"""Finding the camera and rectifying its frames, on photos rendered here from a known homography."""

import time
from dataclasses import replace

import cv2
import numpy as np
import pytest

from pentimento.calibration.observe import CameraCalibration, calibrate_camera, rectify, window_in_camera
from pentimento.contracts.colour import linear_to_srgb, srgb_to_linear
from pentimento.contracts.errors import CalibrationError, ImageError
from pentimento.contracts.markers import DICTIONARY, MarkerLayout, markers_around
from pentimento.contracts.observations import Photo

CANVAS_M = (0.3, 0.2)
LAYOUT = markers_around(CANVAS_M)
CANVAS_WINDOW_M = (0.0, 0.0, 0.3, 0.2)
MARGIN_M = 0.022
PER_M = 12_000  # texture of the table
FRAME = (750, 1060)  # height, width


def homography(tilt: float = 0.0) -> np.ndarray:
    """Canvas metres to pixels of a frame of 3 px/mm, seen slightly from the side."""
    flat = np.array([[2950.0, 20.0, 90.3], [-15.0, -2950.0, 660.6], [0.0, 0.0, 1.0]])
    lean = np.eye(3)
    lean[2] = [tilt * 1.7e-5, tilt * -3e-5, 1.0]
    return lean @ flat


def in_frame(points_m: np.ndarray) -> np.ndarray:
    """Where the tilted camera truly sees canvas points [N, 2]."""
    lifted = np.column_stack((points_m, np.ones(len(points_m)))) @ homography(tilt=1.0).T
    return lifted[:, :2] / lifted[:, 2:]


def table(canvas_linear: np.ndarray) -> np.ndarray:
    """Texture in linear light at PER_M over the canvas and its margin: markers around a painted canvas."""
    margin = round(MARGIN_M * PER_M)
    height, width = round(CANVAS_M[1] * PER_M), round(CANVAS_M[0] * PER_M)
    texture = np.full((height + 2 * margin, width + 2 * margin, 3), 0.7, dtype=np.float32)
    texture[margin:-margin, margin:-margin] = cv2.resize(
        canvas_linear.astype(np.float32), (width, height), interpolation=cv2.INTER_NEAREST
    )
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY))
    side = round(LAYOUT.side_m * PER_M)
    for marker, (x_m, y_m) in zip(LAYOUT.ids, LAYOUT.centres_m, strict=True):
        left = round((x_m - LAYOUT.side_m / 2 + MARGIN_M) * PER_M)
        top = round((CANVAS_M[1] + MARGIN_M - y_m - LAYOUT.side_m / 2) * PER_M)
        print_ = cv2.aruco.generateImageMarker(dictionary, marker, side)
        texture[top : top + side, left : left + side] = np.where(print_ > 0, 0.7, 0.03)[..., None]
    return texture


def photograph(texture: np.ndarray, camera_from_canvas: np.ndarray, noise: float = 0.0) -> Photo:
    """Each camera pixel is the mean of 4 x 4 samples of the texture, in linear light."""
    fine = 4
    canvas_from_texture = np.array(
        [
            [1 / PER_M, 0, 0.5 / PER_M - MARGIN_M],
            [0, -1 / PER_M, CANVAS_M[1] + MARGIN_M - 0.5 / PER_M],
            [0, 0, 1],
        ]
    )
    fine_from_camera = np.array([[fine, 0, (fine - 1) / 2], [0, fine, (fine - 1) / 2], [0, 0, 1]])
    warp = fine_from_camera @ camera_from_canvas @ canvas_from_texture
    seen = cv2.warpPerspective(texture, warp, (FRAME[1] * fine, FRAME[0] * fine), flags=cv2.INTER_LINEAR)
    linear = cv2.resize(seen, (FRAME[1], FRAME[0]), interpolation=cv2.INTER_AREA)
    srgb = 255 * linear_to_srgb(np.clip(linear, 0, 1).astype(np.float64))
    srgb += noise * np.random.default_rng(0).normal(size=srgb.shape)
    return Photo(np.clip(np.rint(srgb), 0, 255).astype(np.uint8), 0.01, 1.0, np.ones(3), 4.0)


def painted_canvas() -> np.ndarray:
    """200 x 300 blocks of 1 mm in linear light: smooth colours with a few strong marks."""
    rows, columns = np.mgrid[0:200, 0:300] / 100
    canvas = 0.4 + 0.2 * np.stack((np.sin(2 * columns), np.cos(3 * rows), np.sin(columns + 2 * rows)), axis=-1)
    canvas[40:60, 100:220] = (0.02, 0.02, 0.3)
    canvas[120:180, 20:30] = (0.8, 0.05, 0.05)
    return canvas


@pytest.fixture(scope="module")
def texture() -> np.ndarray:
    return table(painted_canvas())


@pytest.fixture(scope="module")
def photo(texture: np.ndarray) -> Photo:
    return photograph(texture, homography(tilt=1.0), noise=1.5)


@pytest.fixture(scope="module")
def calibration(photo: Photo) -> CameraCalibration:
    return calibrate_camera(photo, LAYOUT)


def test_the_camera_is_found_to_a_tenth_of_a_pixel(calibration: CameraCalibration) -> None:
    """That is a thirtieth of a millimetre on the canvas: corners, middle and a point between."""
    points_m = np.array([[0, 0], [0.3, 0], [0.3, 0.2], [0, 0.2], [0.15, 0.1], [0.05, 0.15]])
    assert np.linalg.norm(calibration.to_camera(points_m) - in_frame(points_m), axis=1).max() < 0.1
    assert 0 < calibration.reprojection_px < 0.2
    assert calibration.frame_size_px == (FRAME[1], FRAME[0])


def covered(photo: Photo, markers: tuple[int, ...]) -> Photo:
    """A hand on some of the markers."""
    frame = photo.frame.copy()
    for marker in markers:
        x, y = in_frame(LAYOUT.centres_m[[LAYOUT.ids.index(marker)]])[0]
        frame[max(int(y) - 45, 0) : int(y) + 45, max(int(x) - 45, 0) : int(x) + 45] = 128
    return replace(photo, frame=frame)


def test_four_markers_are_enough_and_three_are_not(photo: Photo, calibration: CameraCalibration) -> None:
    few = calibrate_camera(covered(photo, LAYOUT.ids[1::2]), LAYOUT)
    centre = np.array([0.15, 0.1])
    assert few.to_camera(centre) == pytest.approx(calibration.to_camera(centre), abs=0.15)
    with pytest.raises(CalibrationError, match=r"sees 3 of 8 markers and needs 4; .*\[1, 2, 3, 5, 7\]"):
        calibrate_camera(covered(photo, (*LAYOUT.ids[1::2], 2)), LAYOUT)


@pytest.mark.parametrize("radius_px", [3, 4, 6])
def test_ink_splashed_on_a_markers_corner_does_not_move_the_canvas(
    photo: Photo, calibration: CameraCalibration, radius_px: int
) -> None:
    """The detector puts such a corner up to 7 px out; the canvas stays within .02 mm."""
    splashed = photo.frame.copy()
    for marker, corner in ((0, 0), (5, 2)):
        corner_px = in_frame(LAYOUT.corners_m()[marker])[corner]
        outwards_px = corner_px - in_frame(LAYOUT.centres_m[[marker]])[0]
        splash_px = np.rint(corner_px + (radius_px - 1) * outwards_px / np.linalg.norm(outwards_px)).astype(int)
        cv2.circle(splashed, splash_px.tolist(), radius_px, (20, 20, 20), -1)
    seen = calibrate_camera(replace(photo, frame=splashed), LAYOUT)
    points_m = np.array([[0, 0], [0.3, 0], [0.3, 0.2], [0, 0.2], [0.15, 0.1]])
    assert np.linalg.norm(seen.to_camera(points_m) - calibration.to_camera(points_m), axis=1).max() < 0.06
    assert seen.reprojection_px < 0.25


@pytest.mark.parametrize("aside_px", [2.5, 5.0])
def test_corners_found_beside_their_marker_are_looked_for_again(
    photo: Photo, calibration: CameraCalibration, aside_px: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The detector's polygon cuts a corner of three markers; the corners themselves are in plain sight."""

    real = cv2.aruco.ArucoDetector

    class BesideDetector:
        def __init__(self, *settings: object) -> None:
            self._real = real(*settings)

        def detectMarkers(self, image: np.ndarray) -> tuple:
            corners, ids, rejected = self._real.detectMarkers(image)
            for marker in corners[:3]:
                marker[0, 1] += aside_px * np.array([0.6, -0.8])
            return corners, ids, rejected

    monkeypatch.setattr(cv2.aruco, "ArucoDetector", BesideDetector)
    beside = calibrate_camera(photo, LAYOUT)
    points_m = np.array([[0, 0], [0.3, 0], [0.3, 0.2], [0, 0.2], [0.15, 0.1]])
    assert np.linalg.norm(beside.to_camera(points_m) - calibration.to_camera(points_m), axis=1).max() < 0.01
    assert beside.reprojection_px == pytest.approx(calibration.reprojection_px, abs=0.01)


@pytest.mark.parametrize("seed", range(4))
def test_through_a_lens_that_bends_all_corners_count_alike(photo: Photo, seed: int) -> None:
    """No homography fits such corners; that which fits all best is found, and not one that fits some and is aside."""
    centre, bent = np.array([530.0, 375.0]), 3e-8  # of the frame; pixels by pixels cubed
    rows, columns = np.mgrid[: FRAME[0], : FRAME[1]].astype(np.float32)
    away = np.stack([columns, rows], axis=-1) - centre
    taken_from = (centre + away * (1 + bent * (away**2).sum(-1, keepdims=True))).astype(np.float32)
    frame = cv2.remap(photo.frame, taken_from, None, cv2.INTER_LINEAR).astype(np.float64)
    frame += np.random.default_rng(seed).normal(size=frame.shape)
    found = calibrate_camera(replace(photo, frame=np.clip(np.rint(frame), 0, 255).astype(np.uint8)), LAYOUT)

    corners_m = LAYOUT.corners_m().reshape(-1, 2)
    straight = in_frame(corners_m) - centre
    seen = straight
    for _ in range(20):
        seen = straight / (1 + bent * (seen**2).sum(-1, keepdims=True))
    best, _ = cv2.findHomography(corners_m, seen + centre, 0)
    points_m = np.array([[0, 0], [0.3, 0], [0.3, 0.2], [0, 0.2], [0.15, 0.1]])
    lifted = np.column_stack((points_m, np.ones(len(points_m)))) @ best.T
    assert np.linalg.norm(found.to_camera(points_m) - lifted[:, :2] / lifted[:, 2:], axis=1).max() < 0.15
    assert found.reprojection_px > 0.9  # which is the lens


def test_a_view_without_markers_is_refused(photo: Photo) -> None:
    with pytest.raises(CalibrationError, match="sees 0 of 8"):
        calibrate_camera(replace(photo, frame=np.full_like(photo.frame, 200)), LAYOUT)


def test_a_marker_seen_twice_is_refused(photo: Photo) -> None:
    """A print of the lower left marker lies on the canvas."""
    frame = photo.frame.copy()
    x, y = in_frame(LAYOUT.centres_m[:1])[0].round().astype(int)
    frame[300:360, 500:560] = frame[y - 30 : y + 30, x - 30 : x + 30]
    with pytest.raises(CalibrationError, match=r"more than one of marker \[0\]"):
        calibrate_camera(replace(photo, frame=frame), LAYOUT)


def test_markers_of_another_layout_do_not_count(photo: Photo) -> None:
    other = MarkerLayout(ids=tuple(range(20, 28)), centres_m=LAYOUT.centres_m, side_m=LAYOUT.side_m)
    with pytest.raises(CalibrationError, match="sees 0 of 8"):
        calibrate_camera(photo, other)


@pytest.mark.parametrize("per_mm", [0.5, 1.0, 2.0])
def test_each_pixel_is_the_mean_light_of_its_square(
    photo: Photo, calibration: CameraCalibration, per_mm: float
) -> None:
    """Against exact block means of the painting, in linear light, away from its hard edges."""
    seen = srgb_to_linear(rectify(photo, calibration, CANVAS_WINDOW_M, 1000 * per_mm) / 255.0)
    truth = cv2.resize(
        painted_canvas(),
        (seen.shape[1], seen.shape[0]),
        interpolation=cv2.INTER_AREA if per_mm <= 1 else cv2.INTER_NEAREST,
    )
    assert seen.shape == (round(200 * per_mm), round(300 * per_mm), 3)
    error = np.abs(seen - truth).max(axis=-1)[1:-1, 1:-1]
    assert np.median(error) < 0.01
    assert np.mean(error > 0.03) < (0.02 if per_mm < 2 else 0.06)  # hard edges blur over one camera pixel
    assert abs(seen[1:-1, 1:-1].mean() - truth[1:-1, 1:-1].mean()) < 0.003


def test_fine_stripes_keep_their_mean_light(calibration: CameraCalibration) -> None:
    """Stripes of one camera pixel, black and white: half the light, sRGB 188, at every scale.

    Sampling without areas would give black, white or moiré; averaging sRGB bytes would give 128.
    """
    stripes = np.zeros((*FRAME, 3), np.uint8)
    stripes[:, ::2] = 255
    photo = Photo(stripes, 0.01, 1.0, np.ones(3), 0.0)
    for pixels_per_m in (100, 300, 750):
        image = rectify(photo, calibration, (0.01, 0.01, 0.29, 0.19), pixels_per_m).astype(float)
        assert image.mean() == pytest.approx(188, abs=2)
        assert image.std() < 15


def test_rectified_part_equals_that_part_of_the_rectified_whole(photo: Photo, calibration: CameraCalibration) -> None:
    whole = rectify(photo, calibration, CANVAS_WINDOW_M, 2000).astype(int)
    part = rectify(photo, calibration, (0.1, 0.05, 0.18, 0.106), 2000).astype(int)
    assert part.shape == (112, 160, 3)
    difference = np.abs(part - whole[400 - 212 : 400 - 100, 200:360])
    assert difference.mean() < 0.2 and difference.max() <= 6


def test_a_dot_is_where_it_was_painted(calibration: CameraCalibration) -> None:
    """The centroid of a 2 mm dot at (201.5, 149.5) mm, to a twentieth of a millimetre."""
    canvas = np.full((200, 300, 3), 0.7)
    canvas[49:51, 201:203] = 0.02  # rows 49 and 50 from the top: y from 149 to 151 mm
    photo = photograph(table(canvas), homography(tilt=1.0))
    image = srgb_to_linear(rectify(photo, calibration, (0.18, 0.13, 0.22, 0.17), 2000)[..., 0] / 255.0)
    weight = np.clip(0.65 - image, 0, None)
    rows, columns = np.mgrid[0:80, 0:80]
    x_m = 0.18 + ((columns * weight).sum() / weight.sum() + 0.5) / 2000
    y_m = 0.17 - ((rows * weight).sum() / weight.sum() + 0.5) / 2000
    assert (x_m, y_m) == pytest.approx((0.202, 0.150), abs=5e-5)


def test_a_window_in_the_raw_frame(calibration: CameraCalibration) -> None:
    box = window_in_camera(calibration, (0.1, 0.05, 0.2, 0.1))
    assert box[2] - box[0] == pytest.approx(295, rel=0.05)
    assert box[3] - box[1] == pytest.approx(147.5, rel=0.05)


def test_what_the_camera_cannot_see_is_refused(photo: Photo, calibration: CameraCalibration) -> None:
    with pytest.raises(CalibrationError, match="out of the camera's frame"):
        rectify(photo, calibration, (0.0, 0.0, 0.4, 0.2), 1000)
    with pytest.raises(CalibrationError, match="calibrate again"):
        rectify(replace(photo, frame=photo.frame[:-1]), calibration, CANVAS_WINDOW_M, 1000)
    with pytest.raises(ImageError, match="uint8"):
        rectify(replace(photo, frame=photo.frame.astype(float)), calibration, CANVAS_WINDOW_M, 1000)


def test_a_whole_canvas_is_rectified_at_once(photo: Photo, calibration: CameraCalibration) -> None:
    """40 ms on a quiet machine; the best of several runs is allowed twice that on a busy one."""
    taken = []
    for _ in range(6):
        start = time.perf_counter()
        rectify(photo, calibration, CANVAS_WINDOW_M, 2000)
        taken.append(time.perf_counter() - start)
    assert min(taken) < 0.08
