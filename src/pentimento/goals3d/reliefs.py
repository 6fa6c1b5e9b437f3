"""Reliefs of letters and simple shapes (thesis 7.4.2, Figures 7.1 and 7.9 to 7.12), and their placement in the area."""

from __future__ import annotations

import unicodedata

import cv2
import numpy as np
from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.path import Path
from matplotlib.textpath import text_to_path
from numpy.typing import NDArray

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


def letter_relief(text: str, side_px: int, family: str = "DejaVu Serif") -> FloatArray:
    """Letters [side_px, side_px] at −1 in a plate at 0, as large as fits, centred.

    Raises:
        GoalError: there is nothing to draw, matplotlib has no such font, or the font lacks a character.
    """
    text = unicodedata.normalize("NFC", text)
    font = _font(family, text)
    # `ismath` is off, so that dollar signs are letters.
    vertices, codes = text_to_path.get_text_path(font, text)
    polygons = [np.asarray(polygon) for polygon in Path(vertices, codes).to_polygons()]
    if not polygons:
        raise GoalError("There is no letter to sculpt; give at least one character that leaves a mark.")
    corners = np.concatenate(polygons)
    low, high = corners.min(axis=0), corners.max(axis=0)
    fine = _SUPERSAMPLING * side_px
    scale = fine / float((high - low).max())
    offset = 0.5 * (fine - scale * (high - low))
    drawn = np.zeros((fine, fine), np.uint8)
    points = [np.rint((polygon - low) * scale + offset).astype(np.int32) for polygon in polygons]
    cv2.fillPoly(drawn, points, 1)  # even-odd fill keeps the holes of letters
    mask = drawn[::-1].astype(np.float64).reshape(side_px, _SUPERSAMPLING, side_px, _SUPERSAMPLING).mean(axis=(1, 3))
    return -mask


def _font(family: str, text: str) -> FontProperties:
    """The font, if it has a glyph for each character. Others are drawn as placeholders, or not at all."""
    font = FontProperties(family=family)
    try:
        glyphs = get_font(findfont(font, fallback_to_default=False)).get_charmap()
    except ValueError:
        raise GoalError(f"There is no font {family!r}; matplotlib ships 'DejaVu Serif'.") from None
    for character in text:
        hidden = not character.isspace() and unicodedata.category(character)[0] == "C"
        if hidden or character in "\t\n\r" or ord(character) not in glyphs:
            named = f"{character!r} ({unicodedata.name(character, f'U+{ord(character):04X}')})"
            raise GoalError(f"The font {family} has no character {named}; choose another text.")
    return font


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
