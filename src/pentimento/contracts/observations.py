"""Sensor data: a photograph of the canvas, a scan of the clay."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, eq=False)
class Photo:
    """One raw camera frame, not yet rectified to the canvas."""

    frame: npt.NDArray[np.uint8]
    """sRGB [H, W, 3], RGB order, row 0 at the top."""
    exposure_s: float
    gain: float
    """Amplification of the sensor; 1 = none."""
    white_balance: npt.NDArray[np.float64]
    """[3] factors that the camera applied to linear R, G, B."""
    t_s: float
    """When it was taken, since the session's start."""


@dataclass(frozen=True, eq=False)
class Scan:
    """Measured heights, not yet levelled: where the table is tilted in the scan, so is the clay."""

    height_m: npt.NDArray[np.float64]
    """[H, W], row 0 at the top; NaN = hole."""
    window_m: npt.NDArray[np.float64]
    """[4] x_min, y_min, x_max, y_max of the canvas frame."""
    table_plane: npt.NDArray[np.float64]
    """[3] a, b, c of the table's height a x + b y + c in the scan, as the scanner knows it; NaN = unknown."""
    scanner_id: str
    t_s: float
    """When it was taken, since the session's start."""
