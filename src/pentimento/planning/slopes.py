"""Slopes of height maps: central differences, or at a scale, which averages the noise of a scan.

At a scale s, the slope of a line of heights is that of a weighted least-squares line through each pixel's
surroundings, with Gaussian weights of standard deviation s: away from the border the derivative of a Gaussian
(Canny 1986), and exact for planes up to the border. Across the slope, heights are averaged by a least-squares line with
the same weights. White noise of standard deviation σ in pixels of side p then has a slope of variance

    σ² p² / (8 π s⁴)

along each axis, where central differences have σ² / (2 p²).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
AnyArray = NDArray[Any]

_REACH = 4.0
"""Weights are zero beyond this many scales."""
_MIN_SCALE_PX = 0.7
"""Below it, a Gaussian has no more weight on the neighbours of a pixel than central differences have."""


def slope_scale_m(noise_m: float, pixels_per_m: float, tolerated: float) -> float:
    """Scale at which noise of scans adds no more than ``tolerated`` to the squared slope, both axes together; 0 where
    central differences meet that.

    Args:
        noise_m: standard deviation of the heights of a scan; see ``scan_noise_m``.
        tolerated: squared slope, such as a share of the visual error before the first push.
    """
    if (noise_m * pixels_per_m) ** 2 <= tolerated:
        return 0.0
    scale_m = ((noise_m / pixels_per_m) ** 2 / (4 * math.pi * tolerated)) ** 0.25
    return max(scale_m, _MIN_SCALE_PX / pixels_per_m)


def scan_noise_m(one_m: AnyArray, other_m: AnyArray) -> float:
    """Standard deviation of the noise of a scan, from two scans [H, W] of the same surface, without holes.

    From the median absolute difference, so that a few bad pixels do not count; a difference in level does not either.
    """
    difference = np.asarray(one_m, dtype=np.float64) - other_m
    spread = np.median(np.abs(difference - np.median(difference)))
    return float(spread / (_QUARTILE * math.sqrt(2.0)))


_QUARTILE = 0.6744897501960817
"""Median absolute value of a standard normal number."""


class Slopes:
    """Slopes of maps of one shape; linear in the heights."""

    def __init__(self, shape: tuple[int, int], pixels_per_m: float, scale_m: float = 0.0) -> None:
        """A ``scale_m`` of 0 takes central differences, which leave out the outermost pixels."""
        self.rows, self.columns = (Line(count, pixels_per_m, scale_m * pixels_per_m) for count in shape)

    def of(self, height_m: AnyArray) -> tuple[AnyArray, AnyArray]:
        """Slope along x and along y of maps [..., H, W]; row 0 is the top, so y decreases with the row."""
        right = _turned(self.columns.slope(_turned(self.rows.smooth(height_m))))
        up = self.rows.slope(_turned(self.columns.smooth(_turned(-height_m))))
        return right, up

    def of_window(self, change_m: AnyArray, window: tuple[slice, slice]) -> tuple[AnyArray, AnyArray]:
        """The slopes, at a scale above 0, of a map that is ``change_m`` [h, w] in the window and 0 outside."""
        rows, columns = window
        right = self.rows.smoothing[:, rows] @ change_m @ self.columns.differences[:, columns].T
        up = self.rows.differences[:, rows] @ -change_m @ self.columns.smoothing[:, columns].T
        return right, up

    def back(self, right: AnyArray, up: AnyArray) -> AnyArray:
        """The adjoint: the gradient [H, W] of Σ right · slope along x + up · slope along y by the heights."""
        of_right = self.rows.smooth_back(_turned(self.columns.slope_back(_turned(right))))
        of_up = _turned(self.columns.smooth_back(_turned(self.rows.slope_back(up))))
        return of_right - of_up


class Line:
    """Slopes along one axis of ``count`` pixels."""

    def __init__(self, count: int, pixels_per_m: float, scale_px: float) -> None:
        self.count, self.pixels_per_m = count, pixels_per_m
        self.at_scale = scale_px > 0
        self.smoothing, self.differences = (
            _lines_through(count, max(scale_px, _MIN_SCALE_PX)) if self.at_scale else (np.eye(0), np.eye(0))
        )
        """[count, count] each, at a scale above 0."""
        self.differences = self.differences * pixels_per_m

    def smooth(self, height_m: AnyArray) -> AnyArray:
        """Heights [..., count, K], averaged along the axis before the last."""
        return self.smoothing @ height_m if self.at_scale else height_m

    def slope(self, height_m: AnyArray) -> AnyArray:
        """Slopes [..., n, K] along the axis before the last of heights [..., count, K]; n is count, or count - 2."""
        if self.at_scale:
            return np.asarray(self.differences @ height_m)
        return 0.5 * self.pixels_per_m * (height_m[..., 2:, :] - height_m[..., :-2, :])

    def smooth_back(self, gradient: AnyArray) -> AnyArray:
        """The adjoint of ``smooth``."""
        return self.smoothing.T @ gradient if self.at_scale else gradient

    def slope_back(self, gradient: AnyArray) -> AnyArray:
        """The adjoint of ``slope``."""
        if self.at_scale:
            return np.asarray(self.differences.T @ gradient)
        back = np.zeros((*gradient.shape[:-2], self.count, gradient.shape[-1]), gradient.dtype)
        half = 0.5 * self.pixels_per_m * gradient
        back[..., 2:, :] += half
        back[..., :-2, :] -= half
        return back


def _lines_through(count: int, scale_px: float) -> tuple[FloatArray, FloatArray]:
    """[count, count] matrices of the height and the slope, per pixel, of the least-squares line around each pixel."""
    offset = np.arange(count) - np.arange(count)[:, None]
    weight = np.where(np.abs(offset) <= max(_REACH * scale_px, 1.0), np.exp(-0.5 * (offset / scale_px) ** 2), 0.0)
    total = weight.sum(axis=1, keepdims=True)
    mean = (weight * offset).sum(axis=1, keepdims=True) / total
    centred = offset - mean
    slope = weight * centred / (weight * centred**2).sum(axis=1, keepdims=True)
    return weight / total - mean * slope, slope


def _turned(maps: AnyArray) -> AnyArray:
    return np.swapaxes(maps, -1, -2)
