"""A push model in closed form for the sculptor's tests: what lies above the tool's path is pressed down, some to rims.

The tool is a paraboloid that sinks linearly along its way; clay above it sinks to it (softly, so that there are
gradients), and a share of what sank reappears around.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.frames import canvas_to_pixel, canvas_to_stroke, pixel_to_canvas
from pentimento.planning.pushes.memory import FRESH, PushMemory
from pentimento.planning.pushes.rollout import Pull

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

WINDOW_M = np.array([0.0, 0.0, 0.1, 0.1])
SIDE_PX = 48
SURFACE_M = 0.04
_SOFT_M = 1e-4
_STEP = 1e-5


class PressedClay:
    """A ball of this radius in clay of which ``kept`` of what sinks reappears in rims."""

    def __init__(
        self,
        radius_m: float = 0.01,
        kept: float = 0.5,
        strength: float = 1.0,
        end_effector: str = "ball",
        window_m: FloatArray = WINDOW_M,
    ):
        self.window_m = window_m
        self.end_effector = end_effector
        self._radius_m, self._kept, self._strength = radius_m, kept, strength

    def after(self, height_m: Array, actions: FloatArray, memory: PushMemory = FRESH) -> Array:
        return (
            np.array([self._press(height_m.astype(np.float64), action)[0] for action in actions])
            .reshape(-1, *height_m.shape)
            .astype(np.float32)
        )

    def step(self, height_m: Array, action: FloatArray, memory: PushMemory = FRESH) -> tuple[Array, Pull]:
        height = height_m.astype(np.float64)
        after, share, ring, corner, of_corner = self._press(height, action)

        def pull(cotangent: Array) -> tuple[Array, FloatArray]:
            given = cotangent.astype(np.float64)
            of_sunk = -given + self._kept * (given * ring).sum()  # a sunk metre goes down here and up in the ring
            of_height = given + of_sunk * share
            np.add.at(of_height, corner, -(of_sunk * share).sum() * of_corner)  # the tool rides on the start's height
            ends = [
                [float((self._press(height, action + sign * _STEP * unit)[0] * given).sum()) for sign in (-1, 1)]
                for unit in np.eye(5)
            ]
            return of_height.astype(np.float32), np.array([(high - low) / (2 * _STEP) for low, high in ends])

        return after.astype(np.float32), pull

    def _press(self, height: FloatArray, action: FloatArray):
        side = len(height)
        pixels = np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1)
        k = side / self.window_m[2]
        x_m, y_m, theta_rad, length_m, depth_m = action
        local = canvas_to_stroke(pixel_to_canvas(pixels, self.window_m, k), x_m, y_m, theta_rad)
        along = np.clip(local[..., 0], 0, length_m)
        square = (local[..., 0] - along) ** 2 + local[..., 1] ** 2
        corner, weights = _bilinear(canvas_to_pixel((x_m, y_m), self.window_m, k), side)
        sinking = self._strength * depth_m * along / max(length_m, 1e-9)
        bottom = (height[corner] * weights).sum() - sinking + square / (2 * self._radius_m)
        excess = (height - bottom) / _SOFT_M
        sunk = _SOFT_M * np.logaddexp(0, excess)
        share = 1 / (1 + np.exp(-np.clip(excess, -500, 500)))
        ring = np.exp(-(((np.sqrt(square) / self._radius_m - 1.3) / 0.3) ** 2))
        ring /= ring.sum()
        return height - sunk + self._kept * sunk.sum() * ring, share, ring, corner, weights


def flat() -> Array:
    """Clay [H, W] that nothing has touched."""
    return np.full((SIDE_PX, SIDE_PX), SURFACE_M, np.float32)


def _bilinear(column_row: FloatArray, side: int):
    column, row = np.clip(column_row, 0, side - 1.001)
    c, r = int(column), int(row)
    a, b = column - c, row - r
    corner = (np.array([r, r, r + 1, r + 1]), np.array([c, c + 1, c, c + 1]))
    return corner, np.array([(1 - b) * (1 - a), (1 - b) * a, b * (1 - a), b * a])
