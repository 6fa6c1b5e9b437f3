"""A pellet of material as it is laid on the slab, before the pad presses it: an oval lump with a round profile.

The lump is a ball that is stretched to an oval. A height field has no undersides, so that each column holds the chord
of the ball above it.
"""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FINER = 4
"""Columns in each direction by which the lump is sampled in a cell, so that small pellets keep their shape."""


def lump_m(
    shape: tuple[int, int], middle: tuple[float, float], volume_m3: float, ratio: float, turn_rad: float, cell_m: float
) -> Array:
    """Thickness float64[H,W] of the lump around `middle` (column, row), which holds exactly `volume_m3`.

    Its widths are the ball's times and over `ratio`, the first in the direction `turn_rad`. The tray's walls hold it.
    """
    radius_m = (3.0 * volume_m3 / (4.0 * math.pi)) ** (1.0 / 3.0)
    offsets = (np.arange(FINER) + 0.5) / FINER - 0.5
    row, column = np.mgrid[: shape[0], : shape[1]]
    thickness = np.zeros(shape)
    for down in offsets:
        for right in offsets:
            dx, dy = (column + right - middle[0]) * cell_m, (row + down - middle[1]) * cell_m
            along = (dx * math.cos(turn_rad) + dy * math.sin(turn_rad)) / ratio
            across = (dy * math.cos(turn_rad) - dx * math.sin(turn_rad)) * ratio
            thickness += 2.0 * np.sqrt(np.maximum(radius_m**2 - along**2 - across**2, 0.0))
    return np.asarray(thickness * (volume_m3 / (thickness.sum() * cell_m**2)))
