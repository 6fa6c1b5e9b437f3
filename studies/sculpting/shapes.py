"""Reliefs of a face and of a knot from formulas, as in the thesis's artistic sculptures (A.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_FEATURES = (
    # height, x, y of the middle, and spread in x and y; the face reaches from -1 to 1
    (-0.80, 0.30, 0.20, 0.17, 0.12),  # eye sockets
    (0.20, 0.30, 0.19, 0.07, 0.06),  # eyes
    (0.20, 0.30, 0.42, 0.17, 0.07),  # brows
    (0.12, 0.40, -0.15, 0.14, 0.14),  # cheeks
    (0.30, 0.0, 0.12, 0.07, 0.22),  # bridge of the nose
    (0.32, 0.0, -0.10, 0.10, 0.08),  # its tip
    (-0.30, 0.19, -0.20, 0.08, 0.09),  # beside it
    (-0.75, 0.0, -0.48, 0.25, 0.07),  # mouth
    (0.20, 0.0, -0.78, 0.16, 0.09),  # chin
)
"""Gaussians on the oval of a head; those beside the middle have a mirror image."""
_HEAD = (0.76, 0.98)
"""Half-axes of the oval."""


def face(side_px: int) -> FloatArray:
    """A face [side_px, side_px] in sunk relief: from -1 at its outline to 0 at its highest place and around it."""
    x, y = _places(side_px)
    square = (x / _HEAD[0]) ** 2 + (y / _HEAD[1]) ** 2
    height = 0.7 * np.sqrt(np.clip(1 - square**2, 0, None))  # a flattened dome
    for deep, across, up, wide, tall in _FEATURES:
        for side in {across, -across}:
            height += deep * np.exp(-0.5 * (((x - side) / wide) ** 2 + ((y - up) / tall) ** 2))
    inside = square < 1
    height -= height[inside].min()
    return np.where(inside, height / height[inside].max() - 1, 0.0)


_STRAND = 0.16
"""Radius of the knot's strand; the knot reaches from -1 to 1."""
_WOVEN = 0.14
"""How far the strand rises and falls where it crosses itself."""
_SAMPLES = 720


def knot(side_px: int) -> FloatArray:
    """A trefoil knot [side_px, side_px], pressed in: from -1 at its deepest to 0 beside it.

    The strand's middle is at (sin t + 2 sin 2t, cos t - 2 cos 2t, -sin 3t); where it crosses itself, the upper part
    presses deeper.
    """
    t = np.linspace(0, 2 * np.pi, _SAMPLES, endpoint=False)
    middle = np.stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t)], axis=1)
    middle *= (1 - _STRAND) / np.abs(middle).max()
    x, y = _places(side_px)
    top = np.full(x.shape, -np.inf)
    for (at_x, at_y), rise in zip(middle, _WOVEN * -np.sin(3 * t), strict=True):
        beside = _STRAND**2 - (x - at_x) ** 2 - (y - at_y) ** 2
        top = np.maximum(top, np.where(beside > 0, rise + np.sqrt(np.maximum(beside, 0)), -np.inf))
    depth = np.maximum(top + _WOVEN, 0)  # the strand's middle, at its lowest, is level with the plate
    return -depth / depth.max()


def _places(side_px: int) -> tuple[FloatArray, FloatArray]:
    """x and y of the pixels, from -1 to 1, y upwards."""
    along = (np.arange(side_px) + 0.5) / side_px * 2 - 1
    x, y = np.meshgrid(along, -along)
    return x, y
