"""What happens after the tool has pressed: dents spring back, far places rise, and the retract draws a peak."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TOGETHER_M = 0.0016  # over which neighbours come up as one
FIRM_SHARE = 0.5  # of a dent in material that hardly yields any more


def elastic_m(dent: Array, limit_m: float, share: float, setting: float) -> Array:
    """What dents [H,W] recover: shallow ones `share` of their depth, deep ones approach `limit_m`.

    `setting` (0..1) of it is lost to the tool's rest.
    """
    return np.asarray(limit_m * (1.0 - np.exp(-dent * share / limit_m)) * (1.0 - setting))


def firm_m(dent: Array, worked: Array) -> Array:
    """What dents [H,W] recover because worked material yields later, so that more of the push is elastic.

    worked: float64[H,W], relative gain of hardness before the push.
    """
    return np.asarray(FIRM_SHARE * dent * worked / (1.0 + worked))


def spring_back(
    height: Array, pre: Array, elastic: Array, aside_m3: float, lost_m3: float, cell_m: float
) -> tuple[Array, float, float]:
    """The surface, the volume set aside and the volume lost, after the dents' elastic part [H,W] has come back.

    Neighbouring material comes up together. Rims, far places and pores give back as much as the dents regain, so
    that volume is kept.
    """
    if not elastic.any():
        return height, aside_m3, lost_m3
    dent = np.maximum(pre - height, 0.0)
    together = cv2.GaussianBlur(elastic, (0, 0), TOGETHER_M / cell_m, borderType=cv2.BORDER_REFLECT)
    regained = np.minimum(together, dent)
    back = float(regained.sum() / dent.sum())
    rim = np.maximum(height - pre, 0.0)
    return height + regained - back * rim, aside_m3 * (1.0 - back), lost_m3 * (1.0 - back)


def rise_far(shape: tuple[int, int], centre: Array, heading: Array, reach_m: float, cell_m: float) -> Array:
    """Where material comes up far from the contact: weights float64[H,W] of sum 1.

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
