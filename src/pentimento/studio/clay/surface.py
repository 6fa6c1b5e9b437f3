"""The slab's surface as smoothing leaves it, and fields of random texture."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.studio.clay.world import Slab

Array = NDArray[np.float64]

UNDULATION_M = 0.022  # size of the waves that smoothing leaves


def cells_shape(slab: Slab, scan_pixels: int) -> tuple[int, int]:
    """Rows and columns of the height field: at least two cells for each pixel of the scanner."""
    longer = max(slab.cells, 2 * scan_pixels)
    cells_per_m = longer / max(slab.size_m)
    return round(slab.size_m[1] * cells_per_m), round(slab.size_m[0] * cells_per_m)


def smooth_field(shape: tuple[int, int], cells: float, rng: np.random.Generator) -> Array:
    """Random field float64[H,W] of mean 0, standard deviation 1 and a grain of about `cells` cells.

    Drawn on a coarse lattice of a third of the grain, so that the field is the same at every resolution.
    """
    lattice = [max(4, math.ceil(3 * n / cells)) for n in shape]
    coarse = cv2.GaussianBlur(rng.standard_normal(lattice), (0, 0), 1.2, borderType=cv2.BORDER_REFLECT)
    field = cv2.resize(coarse, (shape[1], shape[0]), interpolation=cv2.INTER_CUBIC)
    return np.asarray((field - field.mean()) / field.std())


def fresh_surface(slab: Slab, shape: tuple[int, int], rng: np.random.Generator) -> Array:
    """Height above the table float64[H,W] of the slab as smoothing leaves it."""
    cells_per_m = shape[1] / slab.size_m[0]
    level_m = slab.height_m + slab.height_spread_m * rng.standard_normal()
    waves = smooth_field(shape, UNDULATION_M * cells_per_m, rng)
    grain = smooth_field(shape, 0.0025 * cells_per_m, rng)
    return np.asarray(level_m + slab.undulation_m * waves + slab.roughness_m * grain)
