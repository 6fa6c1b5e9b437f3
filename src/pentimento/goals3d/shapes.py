"""Simple shapes (thesis Figures 7.9 to 7.12): what a sculptor's first lessons are about."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pentimento.planning.pushes.goal import GoalError

FloatArray = NDArray[np.float64]

SHAPES = ("pyramid", "dome", "ridge", "cross", "ripple", "flat")

_BAR = 0.16
"""Half the width of a bar, of half the side."""
_WAVES = 3.0


def shape_relief(name: str, side_px: int) -> FloatArray:
    """A shape [side_px, side_px] from 0 to 1; of bars, those of the X are sunk, the ridge is raised.

    Raises:
        GoalError: no such shape.
    """
    middle = (np.arange(side_px) + 0.5) / side_px * 2 - 1
    x, y = np.meshgrid(middle, -middle)
    match name:
        case "pyramid":
            return np.asarray(1 - np.maximum(np.abs(x), np.abs(y)))
        case "dome":
            return np.sqrt(np.clip(1 - x**2 - y**2, 0, None))
        case "ridge":
            return np.clip(1 - np.abs(y) / (2 * _BAR), 0, None) * (np.abs(x) < 0.9)
        case "cross":
            beside = np.minimum(np.abs(x - y), np.abs(x + y)) / np.sqrt(2)
            return 1.0 - (beside < _BAR)
        case "ripple":
            return np.asarray(0.5 + 0.5 * np.cos(_WAVES * np.pi * np.hypot(x, y)))
        case "flat":
            return np.zeros((side_px, side_px))
    raise GoalError(f"There is no shape {name!r}; known are {', '.join(SHAPES)}.")
