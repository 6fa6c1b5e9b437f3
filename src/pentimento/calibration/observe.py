"""Registration of the camera to the canvas by markers, and rectification of photographs.

The camera model is a pinhole over a flat table: one homography relates canvas and frame. Lens distortion is small. It
shows in the reprojection error, and is a cause of the diagnosis's vocabulary.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb, srgb_to_linear
from pentimento.contracts.errors import CalibrationError, ImageError
from pentimento.contracts.frames import check_window, image_shape
from pentimento.contracts.markers import DICTIONARY, MarkerLayout
from pentimento.contracts.observations import Photo

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]

_MIN_MARKERS = 4
_MODULES = 6  # of a marker's side: 4 of code between two of border
_OUTLIER_PX = 0.5  # a corner is an outlier that misses by more than this
_OUTLIER = 4.0  # and by more than so many times the median miss
_ROUNDS = 3  # of refinement and outlier rejection


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """Pose of the canvas in the camera's frame."""

    camera_from_canvas: FloatArray
    """Homography [3, 3]: (x_m, y_m, 1) in the canvas frame -> (column, row, 1) of the frame, up to scale."""
    reprojection_px: float
    """RMS distance between the marker corners that were used and where the homography puts them."""
    frame_size_px: tuple[int, int]
    """Width and height of the frames that it holds for."""

    def to_camera(self, xy_m: FloatArray) -> FloatArray:
        """Canvas points [..., 2] (metres) -> pixel coordinates [..., 2] (column, row) of the camera frame."""
        return _project(self.camera_from_canvas, np.asarray(xy_m, dtype=np.float64))


def calibrate_camera(photo: Photo, layout: MarkerLayout) -> CameraCalibration:
    """Register the camera to the canvas by the ArUco markers round it.

    The homography is the least-squares fit to all detected corners. Sub-pixel refinement is local and cannot correct a
    corner that is off by pixels: all corners are refined again from their predicted places, and outliers are left out.

    Raises CalibrationError if fewer than four of the layout's markers are seen, or one is seen twice.
    """
    light, found = _find_markers(photo.frame)
    ids = [marker for marker, _ in found if marker in layout.ids]
    twice = sorted({marker for marker in ids if ids.count(marker) > 1})
    if twice:
        raise CalibrationError(f"The camera sees more than one of marker {twice}; take other prints out of its view.")
    if len(ids) < _MIN_MARKERS:
        missing = sorted(set(layout.ids) - set(ids))
        raise CalibrationError(
            f"The camera sees {len(ids)} of {len(layout.ids)} markers and needs {_MIN_MARKERS}; "
            f"uncover or light markers {missing}."
        )
    corners_m = layout.corners_m()
    canvas_m = np.concatenate([corners_m[layout.ids.index(marker)] for marker in ids])  # [4 K, 2]
    seen_px = np.concatenate([corners for marker, corners in found if marker in layout.ids])  # [4 K, 2]
    used = np.ones(len(seen_px), dtype=bool)
    inside_px = np.array(light.shape[::-1]) - 1
    for _ in range(_ROUNDS):
        expected_px = _project(_homography(canvas_m[used], seen_px[used]), canvas_m)  # [4 K, 2]
        starts_px = np.clip(expected_px, 0, inside_px).reshape(-1, 4, 2)
        seen_px = np.concatenate([_refined(light, corners) for corners in starts_px])
        miss_px = np.linalg.norm(seen_px - expected_px, axis=1)
        used = miss_px <= max(_OUTLIER_PX, _OUTLIER * float(np.median(miss_px)))
    homography = _homography(canvas_m[used], seen_px[used])
    miss_px = np.linalg.norm(_project(homography, canvas_m[used]) - seen_px[used], axis=1)
    height, width = photo.frame.shape[:2]
    return CameraCalibration(homography, float(np.sqrt(np.mean(miss_px**2))), (width, height))


def rectify(
    photo: Photo, calibration: CameraCalibration, window_m: Sequence[float] | FloatArray, pixels_per_m: float
) -> Image:
    """The part of the canvas in `window_m` of a photograph: uint8 sRGB [H, W, 3], row 0 at the top.

    Each pixel is the mean in linear light over its square: the frame is sampled on a grid at least as fine as its own
    pixels, then averaged over areas.

    Raises CalibrationError if the calibration is of other frames or the window lies partly outside the
    frame.
    """
    height_px, width_px = photo.frame.shape[:2]
    if photo.frame.dtype != np.uint8 or photo.frame.ndim != 3 or photo.frame.shape[2] != 3:
        raise ImageError(f"The photo is {photo.frame.dtype} {photo.frame.shape}; a frame is uint8 sRGB [H, W, 3].")
    if (width_px, height_px) != calibration.frame_size_px:
        raise CalibrationError(
            f"The photo is {width_px} x {height_px} px and the calibration is of "
            f"{calibration.frame_size_px} px; calibrate again with this camera."
        )
    rows, columns = image_shape(window_m, pixels_per_m)
    corners_px = calibration.to_camera(_corners(window_m))  # [4, 2]
    if corners_px.min() < -0.5 or np.any(corners_px.max(axis=0) > np.array([width_px, height_px]) - 0.5):
        raise CalibrationError(
            f"The window {[float(v) for v in window_m]} m reaches out of the camera's frame; "
            "move the camera or choose a window on the canvas."
        )
    fine = _oversampling(corners_px, rows, columns)
    camera_from_fine = calibration.camera_from_canvas @ _canvas_from_pixel(window_m, rows * fine, columns * fine)
    # Only the part of the frame around the window is linearised and sampled.
    low = np.maximum(np.floor(corners_px.min(axis=0)).astype(int) - 1, 0)
    high = np.minimum(np.ceil(corners_px.max(axis=0)).astype(int) + 2, (width_px, height_px))
    part = cv2.LUT(np.ascontiguousarray(photo.frame[low[1] : high[1], low[0] : high[0]]), _linear_of_srgb())
    shift = np.array([[1.0, 0.0, -low[0]], [0.0, 1.0, -low[1]], [0.0, 0.0, 1.0]])
    sampled = cv2.warpPerspective(
        part,
        shift @ camera_from_fine,
        (columns * fine, rows * fine),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    if fine > 1:
        sampled = cv2.resize(sampled, (columns, rows), interpolation=cv2.INTER_AREA)
    image: Image = _srgb_of_linear()[sampled]
    return image


def window_in_camera(calibration: CameraCalibration, window_m: Sequence[float] | FloatArray) -> FloatArray:
    """The box [4] (column_min, row_min, column_max, row_max) that a canvas window fills in the raw frame."""
    corners = calibration.to_camera(_corners(window_m))
    return np.concatenate((corners.min(axis=0), corners.max(axis=0)))


def marker_detector(dictionary: str) -> cv2.aruco.ArucoDetector:
    """Finds the markers of a dictionary of `cv2.aruco`."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.perspectiveRemovePixelPerCell = 8  # by default 4, which misreads tilted and blurred markers
    return cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary)), parameters)


def _homography(canvas_m: FloatArray, seen_px: FloatArray) -> FloatArray:
    """Homography [3, 3] from canvas points [N, 2] to pixels [N, 2], by least squares.

    RANSAC would choose those corners of a distorted photograph that agree by chance.
    """
    found, _ = cv2.findHomography(canvas_m, seen_px, 0)
    if found is None:
        raise CalibrationError("The marker corners fix no homography; check that the markers lie as printed.")
    return np.array(found, dtype=np.float64)


def _find_markers(frame: Image) -> tuple[NDArray[np.float32], list[tuple[int, FloatArray]]]:
    """Linear light [H, W] of the frame, and of each marker seen its id and corners.

    Corners [4, 2] are (column, row) from the marker's top left clockwise. They are refined in linear light:
    in sRGB a pixel half on black and half on white is nearer to white, which moves every corner a quarter of
    a pixel into its marker.
    """
    corners, ids, _ = marker_detector(DICTIONARY).detectMarkers(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY))
    linear = cv2.LUT(frame, _linear_of_srgb().astype(np.float32))
    light = np.asarray(cv2.cvtColor(linear, cv2.COLOR_RGB2GRAY), dtype=np.float32)
    if len(corners) == 0:  # then ids is None
        return light, []
    places = np.asarray(corners, dtype=np.float64).reshape(-1, 4, 2)
    return light, [(int(marker), _refined(light, place)) for marker, place in zip(ids.ravel(), places, strict=True)]


def _refined(light: NDArray[np.float32], corners: FloatArray) -> FloatArray:
    """Corners [4, 2] of one marker below a pixel."""
    side_px = float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).min())
    reach = max(2, round(0.7 * side_px / _MODULES))  # within the black border, away from the code
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 0.002)
    points = corners.reshape(4, 1, 2).astype(np.float32)
    return np.asarray(cv2.cornerSubPix(light, points, (reach, reach), (-1, -1), stop), dtype=np.float64)[:, 0]


def _oversampling(corners_px: FloatArray, rows: int, columns: int) -> int:
    """How many samples a side each output pixel needs, so that no camera pixel is skipped."""
    top_left, top_right, bottom_right, bottom_left = corners_px
    across = max(np.linalg.norm(top_right - top_left), np.linalg.norm(bottom_right - bottom_left)) / columns
    down = max(np.linalg.norm(bottom_left - top_left), np.linalg.norm(bottom_right - top_right)) / rows
    return max(1, int(np.ceil(max(across, down) - 0.05)))


def _corners(window_m: Sequence[float] | FloatArray) -> FloatArray:
    """Corners [4, 2] of a window: top left, top right, bottom right, bottom left."""
    x_min, y_min, x_max, y_max = check_window(window_m)
    return np.array([[x_min, y_max], [x_max, y_max], [x_max, y_min], [x_min, y_min]])


def _canvas_from_pixel(window_m: Sequence[float] | FloatArray, rows: int, columns: int) -> FloatArray:
    """Homography [3, 3] from (column, row) of an image of the window to canvas metres."""
    x_min, y_min, x_max, y_max = check_window(window_m)
    pixel_x_m, pixel_y_m = (x_max - x_min) / columns, (y_max - y_min) / rows
    return np.array(
        [
            [pixel_x_m, 0.0, x_min + pixel_x_m / 2],
            [0.0, -pixel_y_m, y_max - pixel_y_m / 2],
            [0.0, 0.0, 1.0],
        ]
    )


def _project(homography: FloatArray, points: FloatArray) -> FloatArray:
    """Apply a homography [3, 3] to points [..., 2]."""
    lifted = points @ homography[:, :2].T + homography[:, 2]  # [..., 3]
    projected: FloatArray = lifted[..., :2] / lifted[..., 2:]
    return projected


@cache
def _linear_of_srgb() -> NDArray[np.uint16]:
    """[256] 16-bit linear light of each 8-bit sRGB value."""
    return np.rint(65535 * srgb_to_linear(np.arange(256) / 255)).astype(np.uint16)


@cache
def _srgb_of_linear() -> Image:
    """[65536] 8-bit sRGB of each 16-bit linear value."""
    return np.rint(255 * linear_to_srgb(np.arange(65536) / 65535)).astype(np.uint8)
