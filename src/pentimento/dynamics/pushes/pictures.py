"""Height maps as a person sees clay: lit from the upper left; before, measured and foretold after side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

_LIGHT = np.array([-0.5, 0.5, 0.75]) / np.linalg.norm([-0.5, 0.5, 0.75])
_STEEPER = 1.5
"""Slopes are shown so much steeper than they are."""
_GAP_PX = 3
_WORST_M = 2e-3
"""Errors of so much, up or down, are shown in full colour."""


def hillshade(height_m: NDArray[Any], pixels_per_m: float) -> NDArray[np.uint8]:
    """Grey uint8 [H, W] of heights [H, W] lit from the upper left; row 0 is the top."""
    down, across = np.gradient(np.asarray(height_m, dtype=np.float64) * pixels_per_m * _STEEPER)
    # A surface that rises to the right leans to the left; one that rises down the image leans up it.
    normal = np.stack([-across, down, np.ones_like(down)], axis=-1)
    lit = normal @ _LIGHT / np.linalg.norm(normal, axis=-1)
    return np.asarray(np.rint(255 * np.clip(lit, 0.0, 1.0)), dtype=np.uint8)


def comparison(
    before_m: NDArray[Any],
    measured_m: NDArray[Any],
    predicted_m: NDArray[Any],
    known: NDArray[np.bool_],
    pixels_per_m: float,
) -> NDArray[np.uint8]:
    """RGB uint8: a row for each of [N, H, W] pushes: before, measured, foretold, error (red: foretold too high)."""
    rows = []
    for before, measured, predicted, seen in zip(before_m, measured_m, predicted_m, known, strict=True):
        shaded = [_rgb(hillshade(height, pixels_per_m)) for height in (before, measured, predicted)]
        rows.append(_beside([*shaded, _signed(np.where(seen, predicted - measured, 0.0))], axis=1))
    return _beside(rows, axis=0)


def _rgb(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.repeat(grey[..., None], 3, axis=-1)


def _signed(error_m: NDArray[Any]) -> NDArray[np.uint8]:
    share = np.clip(error_m / _WORST_M, -1.0, 1.0)[..., None]
    red, blue = np.array([178.0, 24.0, 43.0]), np.array([33.0, 102.0, 172.0])
    full = np.where(share > 0, red, blue)
    return np.asarray(np.rint(255.0 + np.abs(share) * (full - 255.0)), dtype=np.uint8)


def _beside(pictures: Sequence[NDArray[np.uint8]], axis: int) -> NDArray[np.uint8]:
    shape = list(pictures[0].shape)
    shape[axis] = _GAP_PX
    gap = np.full(shape, 255, dtype=np.uint8)
    parts = [part for picture in pictures for part in (gap, picture)][1:]
    return np.concatenate(parts, axis=axis)
