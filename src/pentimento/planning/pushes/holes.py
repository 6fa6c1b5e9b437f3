"""Filling of holes in a scanned height map."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError

FloatArray = NDArray[np.float64]

_ENOUGH = 0.02
"""Smallest weight of measured neighbours, as a share of the kernel, with which a hole is filled by their mean. It is
lower where little was measured."""


def fill_holes(height_m: FloatArray) -> tuple[FloatArray, int]:
    """The map [H, W] with each NaN replaced by the weighted mean of measured neighbours, and the number of NaNs.

    The weight is a Gaussian of one pixel, widened until it covers enough measured neighbours.

    Raises:
        ContractError: no pixel was measured, or a height is infinite.
    """
    if np.isinf(height_m).any():
        raise ContractError("The map holds infinite heights; mark unmeasured pixels with NaN.")
    known = np.isfinite(height_m)
    count = int((~known).sum())
    if count == 0:
        return np.asarray(height_m, dtype=np.float64), 0
    if not known.any():
        raise ContractError("The map holds nothing but holes; scan again.")
    middle = float(height_m[known].mean())  # subtracted, since heights differ little from it and sums then stay exact
    filled = np.where(known, height_m - middle, 0.0)
    values, weights, left, sigma = filled.copy(), known.astype(np.float64), ~known, 1.0
    enough = min(_ENOUGH, 0.5 * float(known.mean()))  # the weight that the widest Gaussian reaches everywhere
    while left.any():
        near = np.asarray(cv2.GaussianBlur(weights, (0, 0), sigma, borderType=cv2.BORDER_REFLECT))
        total = np.asarray(cv2.GaussianBlur(values, (0, 0), sigma, borderType=cv2.BORDER_REFLECT))
        now = left & (near > enough)
        filled[now] = total[now] / near[now]
        left &= ~now
        sigma *= 2
    return np.where(known, height_m, filled + middle), count
