"""Gaussians over height maps: what is pressed away at one place rises around it."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_REACH = 4.0  # standard deviations
_WIDE = 0.1  # of a map's side: a kernel from there on costs less as a product of matrices


def spread(maps: Array, sigma_px: float) -> Array:
    """Maps [B, H, W] convolved with a Gaussian of unit sum, float32; what lies beyond their edges counts as 0."""
    reach = int(np.ceil(_REACH * sigma_px))
    kernel = cv2.getGaussianKernel(2 * reach + 1, sigma_px, cv2.CV_32F)
    maps = maps.astype(np.float32, copy=False)
    if len(kernel) > _WIDE * min(maps.shape[1:]):
        return _sums(kernel, maps.shape[1]) @ (maps @ _sums(kernel, maps.shape[2]))
    found = np.empty(maps.shape, dtype=np.float32)
    for into, each in zip(found, maps, strict=True):
        cv2.sepFilter2D(each, -1, kernel, kernel, dst=into, borderType=cv2.BORDER_CONSTANT)
    return found


def _sums(kernel: Array, size: int) -> Array:
    """The weights [size, size] of each place in the sum at each place of a line."""
    reach = len(kernel) // 2
    place = np.arange(size)
    away = place[:, None] - place
    return np.where(abs(away) <= reach, kernel[np.clip(away + reach, 0, 2 * reach), 0], np.float32(0))
