"""A camera over the canvas, by OpenCV, with its photographs corrected by the calibrations."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace

import cv2
import numpy as np

from pentimento.calibration.calibrate import colours_of, lens_of
from pentimento.calibration.colour_chart import true_colours
from pentimento.calibration.lens import straightened
from pentimento.contracts.errors import CalibrationError
from pentimento.contracts.observations import Photo
from pentimento.robots.calibration import Calibration, Kind

_BUFFERED = 4
"""Old frames that a driver may have buffered: they are discarded."""


class Webcam:
    """Takes photographs with the camera of a number."""

    def __init__(self, number: int) -> None:
        """Raises CalibrationError if there is no such camera."""
        self._number, self._started_s = number, time.monotonic()
        self._capture = cv2.VideoCapture(number)
        if not self._capture.isOpened():
            raise CalibrationError(f"There is no camera {number}; see its cable and its number in the rig file.")

    def __call__(self) -> Photo:
        """The present frame. Raises CalibrationError if the camera gives none."""
        for _ in range(_BUFFERED):
            self._capture.grab()
        given, frame = self._capture.read()
        if not given or frame is None:
            raise CalibrationError(f"The camera {self._number} gives no picture; see its cable, and resume.")
        unknown = float("nan")
        seen = np.ascontiguousarray(frame[..., ::-1], dtype=np.uint8)
        return Photo(seen, unknown, unknown, np.full(3, unknown), time.monotonic() - self._started_s)

    def close(self) -> None:
        """Release the camera."""
        self._capture.release()


def corrected(camera: Callable[[], Photo], found: Mapping[Kind, Calibration]) -> Callable[[], Photo]:
    """The camera with its photographs undistorted and colour-corrected by the calibrations."""
    lens = lens_of(found["lens"]) if "lens" in found else None
    colours = colours_of(found["colour"]) if "colour" in found else None

    def photo() -> Photo:
        seen = camera()
        if lens is not None:
            seen = straightened(seen, lens)
        return seen if colours is None else replace(seen, frame=true_colours(seen.frame, colours))

    return photo
