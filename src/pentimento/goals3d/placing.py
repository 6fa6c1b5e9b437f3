"""Where a relief stands in the area, and how fine it may be."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.planning.pushes.goal import GoalError

FloatArray = NDArray[np.float64]


def place(relief: FloatArray, shape: tuple[int, int], share: float) -> FloatArray:
    """A relief [h, w] as large as fits ``share`` of [H, W], in its own proportions, in the middle.

    Around it lies the median of its rim, so that a letter's plate or a picture's edge goes on.

    Raises:
        GoalError: the relief is no map, has holes, or share is not above 0 and at most 1.
    """
    relief = np.asarray(relief, dtype=np.float64)
    if relief.ndim != 2 or min(relief.shape) < 2:
        raise GoalError(f"A relief is [h, w] of at least 2 x 2 pixels, not of shape {relief.shape}.")
    if not np.isfinite(relief).all():
        raise GoalError(
            f"The relief has {int((~np.isfinite(relief)).sum())} holes (NaN); fill them before it is placed."
        )
    if not 0 < share <= 1:
        raise GoalError(f"A relief cannot cover {share} of the area; choose a share above 0 and up to 1.")
    scale = share * min(shape[0] / relief.shape[0], shape[1] / relief.shape[1])
    height, width = (max(round(scale * side), 1) for side in relief.shape)
    way = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    rim = np.concatenate([relief[0], relief[-1], relief[1:-1, 0], relief[1:-1, -1]])
    placed = np.full(shape, float(np.median(rim)))
    top, left = (shape[0] - height) // 2, (shape[1] - width) // 2
    placed[top : top + height, left : left + width] = cv2.resize(relief, (width, height), interpolation=way)
    return placed


def soften(relief: FloatArray, sigma_px: float) -> FloatArray:
    """The relief blurred by a Gaussian: no tool makes walls steeper than its own flank."""
    if sigma_px <= 0:
        return relief
    return np.asarray(cv2.GaussianBlur(relief, (0, 0), sigma_px), dtype=np.float64)
