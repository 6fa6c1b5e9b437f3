"""A photograph as the camera gave it."""

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
