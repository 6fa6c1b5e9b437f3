"""Reliefs of letters and simple shapes (thesis 7.4.2, Figures 7.1 and 7.9 to 7.12), and their placement in the area."""

from __future__ import annotations

import unicodedata
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.goals3d.fonts import drawn, font_for
from pentimento.planning.pushes.goal import GoalError

FloatArray = NDArray[np.float64]
_SUPERSAMPLING = 4
"""Letters are drawn this many times larger and then averaged."""
SHAPES = ("pyramid", "dome", "ridge", "cross", "ripple", "flat")
"""Names of the shapes."""
_BAR = 0.16
"""Half-width of a bar, as a fraction of half the side."""
_WAVES = 3.0
"""Half-periods of the ripple, from its centre to a side."""


def letter_relief(text: str, side_px: int, font: Path | None = None) -> FloatArray:
    """Letters [side_px, side_px] at −1 in a plate at 0, as large as fits, centred.

    Args:
        font: its file; by default the first installed one that has a glyph for each character (``fonts.font_for``).

    Raises:
        GoalError: there is nothing to draw, or no font, or a character that the font lacks.
    """
    text = unicodedata.normalize("NFC", text)
    if not text.strip():
        raise GoalError("There is no letter to sculpt; give at least one character that leaves a mark.")
    mask = drawn(text, font_for(text, font), _SUPERSAMPLING * side_px)
    if not mask.any():
        raise GoalError("There is no letter to sculpt; give at least one character that leaves a mark.")
    mask = _trimmed(mask)
    scale = side_px / max(mask.shape)
    height, width = (max(round(scale * side), 1) for side in mask.shape)
    relief = np.zeros((side_px, side_px))
    top, left = (side_px - height) // 2, (side_px - width) // 2
    small = cv2.resize(mask, (width, height), interpolation=cv2.INTER_AREA)
    relief[top : top + height, left : left + width] = small / -255.0
    return relief


def _trimmed(mask: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The smallest box of a mask [h, w] that holds every mark."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def shape_relief(name: str, side_px: int) -> FloatArray:
    """A shape [side_px, side_px] from 0 to 1. The ridge is raised, the cross is sunk.

    Raises:
        GoalError: there is no such shape.
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


def place(relief: FloatArray, shape: tuple[int, int], share: float) -> FloatArray:
    """A relief [h, w] scaled to fit ``share`` of [H, W] in its own proportions, centred.

    The surroundings are at the median of its rim, so that a letter's plate or a picture's edge continues.

    Raises:
        GoalError: the relief is not a map, has holes, or share is not above 0 and at most 1.
    """
    relief = np.asarray(relief, dtype=np.float64)
    if relief.ndim != 2 or min(relief.shape) < 2:
        raise GoalError(f"A relief is [h, w] of at least 2 x 2 pixels, not of shape {relief.shape}.")
    if not np.isfinite(relief).all():
        raise GoalError(
            f"The relief has {int((~np.isfinite(relief)).sum())} holes (NaN); fill them before it is placed."
        )
    if not 0 < share <= 1:
        raise GoalError(f"A relief cannot cover {share} of the area; choose a share above 0 and up to 1.")
    scale = share * min(shape[0] / relief.shape[0], shape[1] / relief.shape[1])
    height, width = (max(round(scale * side), 1) for side in relief.shape)
    interpolation = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    rim = np.concatenate([relief[0], relief[-1], relief[1:-1, 0], relief[1:-1, -1]])
    placed = np.full(shape, float(np.median(rim)))
    top, left = (shape[0] - height) // 2, (shape[1] - width) // 2
    placed[top : top + height, left : left + width] = cv2.resize(relief, (width, height), interpolation=interpolation)
    return placed


def soften(relief: FloatArray, sigma_px: float) -> FloatArray:
    """The relief blurred by a Gaussian, because no tool makes walls steeper than its own flank."""
    if sigma_px <= 0:
        return relief
    return np.asarray(cv2.GaussianBlur(relief, (0, 0), sigma_px), dtype=np.float64)
