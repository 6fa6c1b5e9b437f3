"""Inputs of the exported encoder graphs: matrices that resize a picture, and random views of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]

_SHARPNESS = -0.5
"""Parameter of the cubic kernel (Keys 1981), as in the antialiased resizing of PyTorch and Pillow."""
_TURN_RAD = 0.12
"""Maximum rotation of a view."""
_SIDES = (0.45, 1.1)
"""Range of a view's side, in sides of the picture. Plans that were seen in parts of a picture, too, resembled the
picture more for an encoder that had not guided them than plans seen in views of nearly its size."""


def random_views(count: int, rng: np.random.Generator) -> Array:
    """Affine maps [count, 2, 3] in coordinates from -1 to 1 over a picture: slightly rotated squares of random size.

    A view that is smaller than the picture stays inside it, but for its corners.
    """
    drawn = rng.uniform(-1, 1, (4, count)).astype(np.float32)
    middle, half = (_SIDES[0] + _SIDES[1]) / 2, (_SIDES[1] - _SIDES[0]) / 2
    turn, side = _TURN_RAD * drawn[0], middle + half * drawn[1]
    cos, sin, shift = side * np.cos(turn), side * np.sin(turn), np.abs(1 - side)
    rows = [np.stack([cos, -sin, shift * drawn[2]], 1), np.stack([sin, cos, shift * drawn[3]], 1)]
    return np.stack(rows, 1).astype(np.float32)


def resizing_matrix(size: int, new_size: int) -> Array:
    """Matrix [new_size, size] of antialiased bicubic resizing of a row of pixels."""
    ratio = size / new_size
    wide = max(ratio, 1.0)
    centers = ratio * (np.arange(new_size) + 0.5)
    first = np.maximum((centers - 2 * wide + 0.5).astype(int), 0)
    last = np.minimum((centers + 2 * wide + 0.5).astype(int), size)
    pixel = np.arange(size)
    weights = _cubic((pixel - centers[:, None] + 0.5) / wide)
    weights[(pixel < first[:, None]) | (pixel >= last[:, None])] = 0.0
    return np.asarray(weights / weights.sum(1, keepdims=True), dtype=np.float32)


def _cubic(x: NDArray[np.float64]) -> NDArray[np.float64]:
    a, x = _SHARPNESS, np.abs(x)
    near = ((a + 2) * x - (a + 3)) * x * x + 1
    far = (((x - 5) * x + 8) * x - 4) * a
    return np.where(x < 1, near, np.where(x < 2, far, 0.0))
