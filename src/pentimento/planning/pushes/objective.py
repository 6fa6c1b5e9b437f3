"""How far clay is from a goal: in 3D and in what the eye sees (thesis eq. 7.5–7.7)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.contracts.frames import Window, pixels_per_m

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

_MM = 1e3


@dataclass(frozen=True)
class Weights:
    """Of the two errors in the objective (thesis eq. 7.7)."""

    error_3d: float
    """Per mm²."""
    visual: float
    """Per squared slope: a slope of 1 rises as steeply as it goes on."""

    def __post_init__(self) -> None:
        if not (self.error_3d >= 0 and self.visual >= 0 and self.error_3d + self.visual > 0):
            raise ValueError(f"The weights are {self.error_3d} and {self.visual}; each is 0 or more, one above 0.")


class ClayObjective:
    """w_3D ‖S' − S‖² + w_viz ‖∇S' − ∇S‖², means over pixels; S' the goal, ∇ central differences.

    Slopes, not colours, are what a light makes visible, whatever light it is.
    """

    def __init__(self, goal_m: Array, window_m: Window, weights: Weights) -> None:
        """Hold the goal, heights [H, W] in metres over ``window_m``.

        Raises:
            ContractError: the goal has a hole, or fewer than 3 pixels a side, or the window does not fit it.
        """
        if goal_m.ndim != 2 or min(goal_m.shape) < 3:
            raise ContractError(f"A goal is a height map of at least 3 x 3 pixels, not of shape {goal_m.shape}.")
        if not np.isfinite(goal_m).all():
            raise ContractError("The goal has holes (NaN) or infinite heights; fill them before planning.")
        self.goal_m = goal_m
        self.weights = weights
        self.pixels_per_m = pixels_per_m(goal_m.shape, window_m)

    def error_3d_mm2(self, height_m: Array) -> FloatArray:
        """Mean squared difference of height [...] of maps [..., H, W], mm²."""
        difference = (height_m - self.goal_m) * _MM
        return np.asarray(np.square(difference).mean(axis=(-2, -1), dtype=np.float64))

    def visual_error(self, height_m: Array) -> FloatArray:
        """Mean squared difference of slope [...] of maps [..., H, W], summed over both axes."""
        right, up = _slopes(height_m - self.goal_m, self.pixels_per_m)
        of_right = np.square(right).mean(axis=(-2, -1), dtype=np.float64)
        return np.asarray(of_right + np.square(up).mean(axis=(-2, -1), dtype=np.float64))

    def values(self, height_m: Array) -> FloatArray:
        """The objective [...] of maps [..., H, W]."""
        total = np.zeros(height_m.shape[:-2])
        if self.weights.error_3d > 0:
            total = total + self.weights.error_3d * self.error_3d_mm2(height_m)
        if self.weights.visual > 0:
            total = total + self.weights.visual * self.visual_error(height_m)
        return total

    def __call__(self, height_m: Array) -> tuple[float, Array]:
        """The objective of one map [H, W], and its gradient [H, W] by the heights, per metre."""
        difference = height_m - self.goal_m
        gradient = (2 * self.weights.error_3d * _MM**2 / difference.size) * difference
        right, up = _slopes(difference, self.pixels_per_m)
        gradient += self.weights.visual * _slopes_back(right, up, difference.shape, self.pixels_per_m)
        return float(self.values(height_m)), gradient.astype(height_m.dtype)


def _slopes(height_m: Array, pixels_per_m: float) -> tuple[Array, Array]:
    """Slope along x [..., H, W − 2] and along y [..., H − 2, W]; row 0 is the top, so y falls with the row."""
    half = 0.5 * pixels_per_m
    return (
        half * (height_m[..., :, 2:] - height_m[..., :, :-2]),
        half * (height_m[..., :-2, :] - height_m[..., 2:, :]),
    )


def _slopes_back(right: Array, up: Array, shape: tuple[int, ...], pixels_per_m: float) -> Array:
    """The gradient [H, W] of the mean squares of both slopes by the heights."""
    gradient = np.zeros(shape, right.dtype)
    of_right, of_up = (pixels_per_m / slope.size * slope for slope in (right, up))  # 2 · half / size
    gradient[:, 2:] += of_right
    gradient[:, :-2] -= of_right
    gradient[:-2, :] += of_up
    gradient[2:, :] -= of_up
    return gradient
