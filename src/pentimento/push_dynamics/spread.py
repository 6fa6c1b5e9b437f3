"""Gaussians over height maps: what is pressed away at one place rises around it."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_REACH = 4.0  # standard deviations


def spread(maps: Array, sigma_px: float) -> Array:
    """Maps [B, H, W] convolved with a Gaussian of unit sum, float32; what lies beyond their edges counts as 0."""
    reach = int(np.ceil(_REACH * sigma_px))
    kernel = cv2.getGaussianKernel(2 * reach + 1, sigma_px, cv2.CV_32F)
    found = np.empty(maps.shape, dtype=np.float32)
    for into, each in zip(found, maps.astype(np.float32, copy=False), strict=True):
        cv2.sepFilter2D(each, -1, kernel, kernel, dst=into, borderType=cv2.BORDER_CONSTANT)
    return found
