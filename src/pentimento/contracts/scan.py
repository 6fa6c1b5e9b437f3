"""A scan of the clay as the scanner gave it."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


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
