"""Lens calibration from photographs of a ChArUco board, and undistortion of photographs.

Model of the lens after OpenCV: pinhole, three radial and two tangential terms. (Zhang, "A flexible new technique
for camera calibration", 2000; ChArUco: OpenCV's documentation of `cv2.aruco`.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb, srgb_to_linear
from pentimento.contracts.errors import CalibrationError
from pentimento.contracts.observations import Photo

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]

SQUARES: Final = (9, 6)
"""Of the board, across and down."""
SQUARE_M: Final = 0.03
_MARKER_SHARE = 0.7
_DICTIONARY = "DICT_5X5_100"  # not that of the markers round the canvas
_MIN_CORNERS = 12
"""Corners that a photograph must show to be used."""
_MIN_PHOTOS = 6
"""Used photographs, at least."""


@dataclass(frozen=True, eq=False)
class Lens:
    """Pinhole matrix and distortion of a camera."""

    matrix: FloatArray
    """[3, 3] pinhole: (column, row, 1) of a direction (x, y, 1)."""
    distortion: FloatArray
    """[5] k1, k2, p1, p2, k3."""
    frame_size_px: tuple[int, int]
    residual_px: float
    """RMS distance of the board's corners from where this lens puts them."""


def board_image(pixels_per_square: int) -> Image:
    """The board to print, grey [H, W], without a margin: print it so that a square measures SQUARE_M."""
    columns, rows = SQUARES
    return np.asarray(_board().generateImage((columns * pixels_per_square, rows * pixels_per_square)), dtype=np.uint8)


def find_lens(photos: Sequence[Photo]) -> Lens:
    """The lens, fitted to photographs of the board at different tilts all over the frame.

    Raises CalibrationError if fewer than six photographs show twelve corners or more, or their sizes differ.
    """
    sizes = {photo.frame.shape[:2] for photo in photos}
    if len(sizes) != 1:
        raise CalibrationError(
            f"The photographs of the board have the sizes {sorted(sizes)}; take all with one camera."
        )
    board = _board()
    detector = cv2.aruco.CharucoDetector(board)
    on_board: list[NDArray[np.float32]] = []
    in_frame: list[NDArray[np.float32]] = []
    for photo in photos:
        corners, ids, _, _ = detector.detectBoard(cv2.cvtColor(photo.frame, cv2.COLOR_RGB2GRAY))
        if ids is None or len(ids) < _MIN_CORNERS:
            continue
        on_board.append(np.asarray(board.getChessboardCorners(), dtype=np.float32)[np.asarray(ids).ravel()])
        in_frame.append(np.asarray(corners, dtype=np.float32).reshape(-1, 2))
    if len(in_frame) < _MIN_PHOTOS:
        raise CalibrationError(
            f"{len(in_frame)} of {len(photos)} photographs show {_MIN_CORNERS} corners of the board or more and "
            f"{_MIN_PHOTOS} are needed; hold the board still, well lit, at different tilts, all over the frame."
        )
    ((height, width),) = sizes
    residual, matrix, distortion, _, _ = cv2.calibrateCamera(on_board, in_frame, (width, height), None, None)
    if not np.all(np.isfinite(matrix)):
        raise CalibrationError("The photographs of the board fix no lens; tilt the board more, in different ways.")
    return Lens(
        np.asarray(matrix, dtype=np.float64),
        np.asarray(distortion, dtype=np.float64).ravel()[:5],
        (width, height),
        float(residual),
    )


def through_lens(lens: Lens, points_px: FloatArray) -> FloatArray:
    """Undistorted pixel coordinates of points [N, 2] (column, row) of the frame."""
    shaped = np.asarray(points_px, dtype=np.float64).reshape(-1, 1, 2)
    straight = cv2.undistortPoints(shaped, lens.matrix, lens.distortion, P=lens.matrix)
    return np.asarray(straight, dtype=np.float64).reshape(-1, 2)


def straightened(photo: Photo, lens: Lens) -> Photo:
    """The undistorted photograph, with the same camera matrix."""
    height, width = photo.frame.shape[:2]
    if (width, height) != lens.frame_size_px:
        raise CalibrationError(
            f"The photo is {width} x {height} px and the lens was found at {lens.frame_size_px} px; calibrate again."
        )
    column, row = cv2.initUndistortRectifyMap(
        lens.matrix, lens.distortion, np.eye(3), lens.matrix, (width, height), cv2.CV_32FC1
    )
    linear = srgb_to_linear(np.arange(256, dtype=np.float32) / np.float32(255))[photo.frame]
    moved = cv2.remap(linear, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    frame = np.rint(255 * linear_to_srgb(np.asarray(moved, dtype=np.float32))).astype(np.uint8)
    return Photo(frame, photo.exposure_s, photo.gain, photo.white_balance, photo.t_s)


def _board() -> cv2.aruco.CharucoBoard:
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, _DICTIONARY))
    return cv2.aruco.CharucoBoard(SQUARES, SQUARE_M, _MARKER_SHARE * SQUARE_M, dictionary)
