"""Letters to sink into clay, without a font library: OpenCV's own plain ones."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.planning.pushes.goal import GoalError

FloatArray = NDArray[np.float64]

_FONT = cv2.FONT_HERSHEY_SIMPLEX
_THIN = 1
"""Strokes of a seventh of the letter's height: about as wide as a ball's groove where the letter fills a slab."""
_DRAWN_PX = 512
_MARGIN_PX = 32


def sunken_letters(text: str, shape: tuple[int, int], share: float, soften_px: float) -> FloatArray:
    """Letters at −1 in a plate at 0, [H, W]: as large as fits ``share`` of the area's sides, in its middle.

    Args:
        soften_px: width of the Gaussian that the letters' edges are softened by.

    Raises:
        GoalError: there is nothing to draw, or a character that these letters lack.
    """
    if not text.strip() or not all(" " <= character <= "~" for character in text):
        raise GoalError(f"The letters {text!r} cannot be drawn; give one or more of A to Z, digits and plain signs.")
    scale = cv2.getFontScaleFromHeight(_FONT, _DRAWN_PX, _THIN)
    (width, height), below = cv2.getTextSize(text, _FONT, scale, _THIN)
    drawn = np.zeros((height + below + height // 2 + 2 * _MARGIN_PX, width + 2 * _MARGIN_PX), np.uint8)
    cv2.putText(drawn, text, (_MARGIN_PX, height + _MARGIN_PX), _FONT, scale, 255, _THIN, cv2.LINE_AA)
    rows, columns = np.flatnonzero(drawn.any(axis=1)), np.flatnonzero(drawn.any(axis=0))
    drawn = drawn[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    fit = share * min(shape[0] / drawn.shape[0], shape[1] / drawn.shape[1])
    tall, wide = (max(round(fit * side), 1) for side in drawn.shape)
    relief = np.zeros(shape)
    top, left = (shape[0] - tall) // 2, (shape[1] - wide) // 2
    small = cv2.resize(drawn, (wide, tall), interpolation=cv2.INTER_AREA)
    relief[top : top + tall, left : left + wide] = small / -255.0
    return np.asarray(cv2.GaussianBlur(relief, (0, 0), soften_px), dtype=np.float64) if soften_px > 0 else relief
