"""Slopes that do not hold: material runs downhill until every slope is at rest."""

import math

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

ROUNDS = 400
AT_REST_M = 2e-6  # a flow below this is at rest
FINE_M = 0.0005  # cells below this run off in larger ones first
BORDER_M = 0.016  # around what has changed: beyond that nothing runs off


def run_off(height: Array, changed: NDArray[np.bool_], rest_slope: Array, trigger: float, cell_m: float) -> None:
    """`slide` in the box around the cells that have changed, in place; all grids are [H,W]."""
    rows, columns = np.nonzero(changed)
    border = math.ceil(BORDER_M / cell_m)
    box = tuple(slice(max(int(at.min()) - border, 0), int(at.max()) + border + 1) for at in (rows, columns))
    inside = height[box].copy()
    _run_off_coarse_to_fine(inside, rest_slope[box].copy(), trigger, cell_m)
    height[box] = inside


def _run_off_coarse_to_fine(height: Array, rest_slope: Array, trigger: float, cell_m: float) -> None:
    """`slide`, first in cells of twice the size where they are fine: the rounds grow with the cells' number."""
    rows, columns = (side // 2 * 2 for side in height.shape)
    if cell_m < FINE_M:
        coarse, slope = _halved(height[:rows, :columns]), _halved(rest_slope[:rows, :columns])
        before = coarse.copy()
        _run_off_coarse_to_fine(coarse, slope, trigger, 2 * cell_m)
        # Linear interpolation by two keeps the sum, and so the volume.
        height[:rows, :columns] += cv2.resize(coarse - before, (columns, rows), interpolation=cv2.INTER_LINEAR)
    slide(height, rest_slope, trigger, cell_m)


def _halved(field: Array) -> Array:
    rows, columns = field.shape
    return np.asarray(cv2.resize(field, (columns // 2, rows // 2), interpolation=cv2.INTER_AREA), dtype=np.float64)


@njit(cache=True, error_model="numpy")
def slide(height: Array, rest_slope: Array, trigger: float, cell_m: float) -> int:
    """Let what is too steep run down, in place; returns the rounds that it took. Volume is kept.

    height: float64[H,W] metres; rest_slope: float64[H,W] slope at which a cell comes to rest; a cell at rest
    starts only above `trigger` times that. The border is a wall.
    """
    rows, columns = height.shape
    awake = np.zeros((rows, columns), np.bool_)
    for turn in range(ROUNDS):
        largest = 0.0
        for i in range(rows):
            r = i if turn % 2 == 0 else rows - 1 - i
            for j in range(columns):
                c = j if turn % 4 < 2 else columns - 1 - j
                bound = rest_slope[r, c] * (1.0 if awake[r, c] else trigger)
                for dr in range(-1, 2):
                    for dc in range(-1, 2):
                        rr, cc = r + dr, c + dc
                        if (dr == 0 and dc == 0) or rr < 0 or rr >= rows or cc < 0 or cc >= columns:
                            continue
                        run_m = cell_m * math.sqrt(dr * dr + dc * dc)
                        drop = height[r, c] - height[rr, cc]
                        if drop <= bound * run_m:
                            continue
                        flow = 0.2 * (drop - rest_slope[r, c] * run_m)
                        if flow < AT_REST_M:
                            continue
                        height[r, c] -= flow
                        height[rr, cc] += flow
                        awake[r, c] = awake[rr, cc] = True
                        bound = rest_slope[r, c]
                        largest = max(largest, flow)
        if largest == 0.0:
            return turn
    return ROUNDS
