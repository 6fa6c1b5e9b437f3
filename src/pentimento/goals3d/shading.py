"""Rendering of a height map as a photograph: matte clay in raking light from the upper left."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb, to_uint8
from pentimento.contracts.frames import Window, pixels_per_m

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]

_CLAY = np.array([0.68, 0.38, 0.23])
"""Albedo of terracotta, linear light."""
_LIGHT = np.array([-0.62, 0.62, 0.36])
"""Direction of the light: left, far (up in the picture), above."""
_SKY = 0.25
"""Ambient light, relative to the lamp."""
_HOLLOW_M = 0.006
"""Radius of the neighbourhood in which hollows are darkened (ambient occlusion)."""
_SHADOW_STEPS = 48
"""Length of cast shadows, in pixels."""


def photograph(height_m: Array, window_m: Window, scale: int = 3) -> Image:
    """sRGB [scale·H, scale·W, 3] of heights [H, W]: Lambert's law, cast shadows, and ambient occlusion."""
    shape = (scale * height_m.shape[1], scale * height_m.shape[0])
    height = np.asarray(cv2.resize(height_m.astype(np.float64), shape, interpolation=cv2.INTER_CUBIC), np.float64)
    k = pixels_per_m(height.shape, window_m)
    down, right = np.gradient(height, 1 / k)
    normal = np.stack([-right, down, np.ones_like(height)], axis=-1)  # y is up, rows go down
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    light = _LIGHT / np.linalg.norm(_LIGHT)
    lamp = np.clip(normal @ light, 0.0, 1.0) * _lit(height, light, k)
    around = np.asarray(cv2.GaussianBlur(height, (0, 0), _HOLLOW_M * k, borderType=cv2.BORDER_REFLECT))
    sky = np.clip(1.0 + 0.5 * (height - around) / (0.25 * _HOLLOW_M), 0.35, 1.2) * (0.5 + 0.5 * normal[..., 2])
    return to_uint8(linear_to_srgb(np.clip((lamp + _SKY * sky)[..., None] * _CLAY, 0.0, 1.0)))


def _lit(height: FloatArray, light: FloatArray, k: float) -> FloatArray:
    """[H, W]: 1 where the lamp is visible, 0 in its shadow, with soft edges."""
    across = light[:2] / np.linalg.norm(light[:2])
    rise_m = light[2] / np.linalg.norm(light[:2]) / k  # of the ray, per pixel of way
    above = np.full(height.shape, -np.inf)
    rows, columns = np.indices(height.shape)
    for step in range(1, _SHADOW_STEPS + 1):
        x = np.asarray(columns + step * across[0], dtype=np.float32)
        y = np.asarray(rows - step * across[1], dtype=np.float32)
        seen = cv2.remap(height.astype(np.float32), x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        above = np.maximum(above, seen - step * rise_m - height)
    return np.asarray(np.clip(1.0 - above / (2 * rise_m), 0.0, 1.0))
