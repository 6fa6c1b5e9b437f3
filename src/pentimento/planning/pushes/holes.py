"""Holes of a scan, filled: plans need a height everywhere."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError

FloatArray = NDArray[np.float64]

_ENOUGH = 0.02
"""Weight of measured neighbours, as a share, from which a hole is filled by their mean; less where little was seen."""


def fill_holes(height_m: FloatArray) -> tuple[FloatArray, int]:
    """The map [H, W] with each NaN at the mean of what was measured around it, and how many there were.

    Neighbours are weighted by a Gaussian that is widened, from one pixel on, until it meets enough of them.

    Raises:
        ContractError: nothing was measured, or heights are infinite.
    """
    if np.isinf(height_m).any():
        raise ContractError("The map holds infinite heights; mark what was not measured with NaN.")
    known = np.isfinite(height_m)
    count = int((~known).sum())
    if count == 0:
        return np.asarray(height_m, dtype=np.float64), 0
    if not known.any():
        raise ContractError("The map holds nothing but holes; the scanner saw nothing, so scan again.")
    middle = float(height_m[known].mean())  # heights differ little from it: sums stay exact
    filled = np.where(known, height_m - middle, 0.0)
    values, weights, left, sigma = filled.copy(), known.astype(np.float64), ~known, 1.0
    enough = min(_ENOUGH, 0.5 * float(known.mean()))  # what the widest Gaussian meets everywhere
    while left.any():
        near = np.asarray(cv2.GaussianBlur(weights, (0, 0), sigma, borderType=cv2.BORDER_REFLECT))
        total = np.asarray(cv2.GaussianBlur(values, (0, 0), sigma, borderType=cv2.BORDER_REFLECT))
        now = left & (near > enough)
        filled[now] = total[now] / near[now]
        left &= ~now
        sigma *= 2
    return np.where(known, height_m, filled + middle), count
