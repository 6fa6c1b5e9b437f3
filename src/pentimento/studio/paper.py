"""The sheet: its texture, the way it lies, and how liquid spreads in it."""

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from pentimento.studio.world import Effects, Paper

CELLS_PER_M = 4000.0
BLEED_M = 0.00055  # wicking distance in a blotting paper at strength 1
WICKING_M_PER_SQRT_S = 0.0009

Field = NDArray[np.float32]


def sheet_shape(paper: Paper) -> tuple[int, int]:
    """Rows and columns of the fine grid."""
    return round(paper.size_m[1] * CELLS_PER_M), round(paper.size_m[0] * CELLS_PER_M)


def grain_field(paper: Paper, rng: np.random.Generator) -> Field:
    """Height of the paper's texture by rank, float32[H,W] uniform in [0,1] (1 = peaks, which paint reaches
    first).
    """
    shape = sheet_shape(paper)
    size = paper.grain_m * CELLS_PER_M
    fine = cv2.GaussianBlur(rng.standard_normal(shape, dtype=np.float32), (0, 0), 0.45 * size)
    coarse = cv2.GaussianBlur(rng.standard_normal(shape, dtype=np.float32), (0, 0), 1.6 * size)
    height = fine / fine.std() + 0.6 * coarse / coarse.std()
    # The logistic function with this slope is the normal distribution's rank to 1 %.
    return np.asarray(1 / (1 + np.exp(-1.702 * height / height.std())), dtype=np.float32)


def absorbency_field(paper: Paper, rng: np.random.Generator) -> Field:
    """How far liquid travels in the sheet, float32[H,W]: patches of centimetres, and the sheet's humidity
    on the day.
    """
    rows, columns = sheet_shape(paper)
    humidity = float(np.exp(0.35 * rng.standard_normal()))
    coarse = rng.standard_normal((rows // 40 + 2, columns // 40 + 2), dtype=np.float32)
    patches = cv2.resize(cv2.GaussianBlur(coarse, (0, 0), 1.0), (columns, rows), interpolation=cv2.INTER_CUBIC)
    thirst = paper.absorbency * humidity * np.exp(0.9 * patches)
    return np.asarray(thirst / (0.5 + thirst), dtype=np.float32)


def surface_height_m(paper: Paper, effects: Effects, xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Height of the sheet above the plane that the robot believes in, for positions float64[M,2]
    (`canvas_tilt`).
    """
    half = 0.5 * np.asarray(paper.size_m)
    u, v = ((xy_m - half) / half).T
    plane = paper.tilt_m[0] * u + paper.tilt_m[1] * v
    bow = paper.bow_m * (np.cos(0.5 * np.pi * u) * np.cos(0.5 * np.pi * v) - 0.35 * u * v)
    return np.asarray(effects.canvas_tilt * (plane + bow))


def spread(film: NDArray[np.float32], reach_cells: Field, grain: Field) -> None:
    """Let liquid wick outwards in place, conserving its volume: film float32[H,W,C], reach float32[H,W] in
    cells.

    An explicit diffusion whose conductivity follows the fibres, so that edges feather; after it a line's
    edge has about `reach_cells` as standard deviation.
    """
    largest = float(reach_cells.max(initial=0.0))
    steps = int(np.ceil(largest**2 / 2 / 0.22))
    if steps == 0:
        return
    conductivity = (reach_cells**2 / (2 * steps) * (0.35 + 1.3 * grain)).astype(np.float32)
    np.minimum(conductivity, np.float32(0.24), out=conductivity)
    buffer = np.empty_like(film)
    for _ in range(steps):
        _diffuse(film, conductivity, buffer)
        film[:] = buffer


@njit(cache=True)
def _diffuse(film: NDArray[np.float32], conductivity: Field, out: NDArray[np.float32]) -> None:
    rows, columns, channels = film.shape
    out[:] = film
    for r in range(rows):
        for c in range(columns):
            for side in range(2):
                r2, c2 = r + side, c + 1 - side
                if r2 >= rows or c2 >= columns or (film[r, c, 0] == 0 and film[r2, c2, 0] == 0):
                    continue
                k = 0.5 * (conductivity[r, c] + conductivity[r2, c2])
                for i in range(channels):
                    flow = k * (film[r, c, i] - film[r2, c2, i])
                    out[r, c, i] -= flow
                    out[r2, c2, i] += flow
