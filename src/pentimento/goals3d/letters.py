"""Letters in a serif font, sunk into a plate (thesis 7.4.2, Figure 7.1)."""

from __future__ import annotations

import cv2
import numpy as np
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath
from numpy.typing import NDArray

from pentimento.planning.pushes.goal import GoalError

FloatArray = NDArray[np.float64]

_FINE = 4
"""Drawn so many times larger, then averaged."""


def letter_relief(text: str, side_px: int, family: str = "DejaVu Serif") -> FloatArray:
    """Letters [side_px, side_px] at −1 in a plate at 0: as large as fits, in the middle.

    Raises:
        GoalError: nothing to draw, or matplotlib has no such font.
    """
    if not text.strip():
        raise GoalError("There is no letter to sculpt; give at least one character that leaves a mark.")
    try:
        path = TextPath((0, 0), text, size=100, prop=_font(family))
    except ValueError:
        raise GoalError(f"There is no font {family!r}; matplotlib ships 'DejaVu Serif'.") from None
    polygons = [np.asarray(polygon) for polygon in path.to_polygons()]
    corners = np.concatenate(polygons)
    low, high = corners.min(axis=0), corners.max(axis=0)
    fine = _FINE * side_px
    scale = fine / float((high - low).max())
    offset = 0.5 * (fine - scale * (high - low))
    drawn = np.zeros((fine, fine), np.uint8)
    points = [np.rint((polygon - low) * scale + offset).astype(np.int32) for polygon in polygons]
    cv2.fillPoly(drawn, points, 1)  # even-odd: the hole of an A stays a hole
    mask = drawn[::-1].astype(np.float64).reshape(side_px, _FINE, side_px, _FINE).mean(axis=(1, 3))
    return -mask


def _font(family: str) -> FontProperties:
    from matplotlib.font_manager import findfont

    font = FontProperties(family=family)
    findfont(font, fallback_to_default=False)
    return font
