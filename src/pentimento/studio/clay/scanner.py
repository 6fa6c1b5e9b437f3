"""The structured-light scanner: a camera straight above the tray, a projector at its side.

Heights have noise that grows on slopes and are quantised. Nothing is measured in shadow, where the light grazes the
surface, and at random dropouts.
"""

import math

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from pentimento.studio.clay.slab import smooth_field
from pentimento.studio.clay.world import Scanner

Array = NDArray[np.float64]


def table_plane(scanner: Scanner) -> Array:
    """True a, b, c of the table's height a x + b y + c in the scan."""
    return np.array([*scanner.tilt, scanner.lift_m])


def calibrated_plane(scanner: Scanner, rng: np.random.Generator) -> Array:
    """The same as calibrated, with an error."""
    return np.asarray(table_plane(scanner) * (1.0 + scanner.plane_error * rng.standard_normal(3)))


def scan_height_m(height: Array, size_m: tuple[float, float], scanner: Scanner, rng: np.random.Generator) -> Array:
    """Measured heights float64[H,W] of the surface (float64[rows,columns] over the table), NaN in holes."""
    shape = tuple(round(scanner.pixels * length / max(size_m)) for length in (size_m[1], size_m[0]))
    seen = cv2.resize(height, (shape[1], shape[0]), interpolation=cv2.INTER_AREA)
    pixel_m = size_m[0] / shape[1]
    x_m = (np.arange(shape[1]) + 0.5) * pixel_m
    y_m = size_m[1] - (np.arange(shape[0]) + 0.5) * pixel_m
    up, right = np.gradient(seen, pixel_m)  # down the rows, along the columns
    slope2 = up**2 + right**2
    light = np.array([math.cos(scanner.azimuth_rad), math.sin(scanner.azimuth_rad)]) * math.cos(scanner.elevation_rad)
    cosine = (math.sin(scanner.elevation_rad) - right * light[0] + up * light[1]) / np.sqrt(1.0 + slope2)
    # Whether a pixel is seen at its limit depends on the surface's gloss there, which comes in patches.
    gloss = 0.05 * smooth_field((shape[0], shape[1]), 3.0, rng)
    lost = rng.random(shape) < scanner.dropout * (1.0 + 8.0 * slope2)
    toward = (light[0] / math.cos(scanner.elevation_rad), -light[1] / math.cos(scanner.elevation_rad))
    dark = in_shadow(seen, toward[0], toward[1], math.tan(scanner.elevation_rad) * pixel_m)
    noise = scanner.noise_m * (1.0 + scanner.slope_noise * slope2) * rng.standard_normal(shape)
    plane = table_plane(scanner)
    measured = seen + noise + plane[0] * x_m + (plane[1] * y_m + plane[2])[:, None]
    measured = np.rint(measured / scanner.step_m) * scanner.step_m
    return np.where((cosine + gloss < scanner.grazing) | lost | dark, np.nan, measured)


@njit(cache=True, error_model="numpy")
def in_shadow(height: Array, toward_column: float, toward_row: float, rise_m: float) -> NDArray[np.bool_]:
    """bool[H,W]: whether something stands between a pixel and the projector, whose ray rises `rise_m` a pixel."""
    rows, columns = height.shape
    top = height.max()
    dark = np.zeros((rows, columns), np.bool_)
    for r in range(rows):
        for c in range(columns):
            way = 1.0
            while True:
                ray = height[r, c] + way * rise_m
                rr, cc = math.floor(r + way * toward_row + 0.5), math.floor(c + way * toward_column + 0.5)
                if ray > top or rr < 0 or rr >= rows or cc < 0 or cc >= columns:
                    break
                if height[rr, cc] > ray:
                    dark[r, c] = True
                    break
                way += 1.0
    return dark
