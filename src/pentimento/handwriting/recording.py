"""One stroke as it was recorded, before anything was repaired: what every importer gives and `repair` takes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

T: Final = 0
XY: Final = slice(1, 3)
Z: Final = 3
PRESSURE: Final = 4


@dataclass(frozen=True, eq=False)
class Recording:
    """The pen from its touch to its lift."""

    session: str
    """One uninterrupted recording."""
    hand: str
    """Whose."""
    points: FloatArray
    """[K, 5] t_s, x_m, y_m, z_m (height of the tip over the paper), pressure in 0..1; y up. NaN in t, z and pressure:
    not recorded. NaN in x or y: the tracker lost the pen."""


def recording(
    session: str,
    hand: str,
    xy_m: FloatArray,
    t_s: FloatArray | None = None,
    z_m: FloatArray | None = None,
    pressure: FloatArray | None = None,
) -> Recording:
    """A recording of these columns, each [K] but ``xy_m`` [K, 2]; None: not recorded."""
    points = np.full((len(xy_m), 5), np.nan)
    points[:, XY] = xy_m
    for column, values in ((T, t_s), (Z, z_m), (PRESSURE, pressure)):
        if values is not None:
            points[:, column] = values
    return Recording(session, hand, points)
