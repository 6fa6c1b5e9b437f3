"""After the push: dents spring back, the far field rises, the retract draws a peak, and steep slopes slide."""

import math
from typing import NamedTuple

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

TOGETHER_M = 0.0016  # standard deviation of the smoothing of the recovery
FIRM_SHARE = 0.5  # of a dent that recovers in fully hardened material


def elastic_m(dent: Array, limit_m: float, share: float, setting: float) -> Array:
    """Elastic recovery of dents [H,W]: `share` of the depth of shallow ones, at most `limit_m` of deep ones.

    The fraction `setting` (0..1) of it is lost during the tool's dwell.
    """
    return np.asarray(limit_m * (1.0 - np.exp(-dent * share / limit_m)) * (1.0 - setting))


def firm_m(dent: Array, worked: Array) -> Array:
    """Elastic recovery of dents [H,W] in worked material, which yields later so that more of the push is elastic.

    worked: float64[H,W], relative gain of hardness before the push.
    """
    return np.asarray(FIRM_SHARE * dent * worked / (1.0 + worked))


class Recovered(NamedTuple):
    """The material after the elastic recovery of its dents."""

    height: Array
    """[H,W]."""
    aside_m3: float
    """Volume that rises far from the contact."""
    lost_m3: float
    """Volume of crushed pores."""


def spring_back(
    height: Array, pre: Array, elastic: Array, *, aside_m3: float, lost_m3: float, cell_m: float
) -> Recovered:
    """The material after the recovery of the dents' elastic part [H,W].

    The recovery is smoothed over neighbours. Rims, far field and pores lose the volume that the dents regain.
    """
    if not elastic.any():
        return Recovered(height, aside_m3, lost_m3)
    dent = np.maximum(pre - height, 0.0)
    together = cv2.GaussianBlur(elastic, (0, 0), TOGETHER_M / cell_m, borderType=cv2.BORDER_REFLECT)
    regained = np.minimum(together, dent)
    back = float(regained.sum() / dent.sum())
    rim = np.maximum(height - pre, 0.0)
    return Recovered(height + regained - back * rim, aside_m3 * (1.0 - back), lost_m3 * (1.0 - back))


def rise_far(shape: tuple[int, int], centre: Array, heading: Array, reach_m: float, cell_m: float) -> Array:
    """Far field: weights float64[H,W] of sum 1 for the material that rises far from the contact.

    Long-tailed around `centre` (column, row), stronger ahead of the tool than behind it; the tray's walls hold it.
    """
    row, column = np.mgrid[: shape[0], : shape[1]]
    dx, dy = (column - centre[0]) * cell_m, (row - centre[1]) * cell_m
    distance = np.hypot(dx, dy)
    ahead = (dx * heading[0] + dy * heading[1]) / (distance + 0.3 * reach_m)
    weight = (1.0 + 0.6 * ahead) * (1.0 + (distance / reach_m) ** 2) ** -1.5
    return np.asarray(weight / weight.sum())


def draw_peak(height: Array, contact: NDArray[np.bool_], peak_m: float, cell_m: float) -> Array:
    """The surface after the tool has lifted off and drawn up a peak where it rested, from around it.

    contact: bool[H,W], where the tool touched last.
    """
    if peak_m == 0.0 or not contact.any():
        return height
    rows, columns = np.nonzero(contact)
    radius_m = math.sqrt(len(rows) / math.pi) * cell_m
    row, column = np.mgrid[: height.shape[0], : height.shape[1]]
    distance = np.hypot(row - rows.mean(), column - columns.mean()) * cell_m / radius_m
    peak = np.clip(1.0 - distance, 0.0, None) ** 1.5
    collar = np.exp(-(((distance - 1.0) / 0.45) ** 2))
    return np.asarray(height + peak_m * (peak - collar * (peak.sum() / collar.sum())))


ROUNDS = 400  # at most; slopes are at rest long before
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
    """Let too steep slopes run down, in place; returns the number of rounds. Volume is kept.

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
