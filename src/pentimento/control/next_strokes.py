"""A picture of what comes next: the strokes to be made, drawn over the canvas as it is."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.frames import canvas_to_pixel
from pentimento.contracts.plan import PlannedStroke

Picture = NDArray[np.uint8]

_LARGER = 3
_SUBPIXEL = 4  # binary places of OpenCV's coordinates
_LINE, _START = (214, 40, 57), (20, 90, 160)


def drawn_over(canvas: Picture, strokes: Sequence[PlannedStroke], canvas_size_m: tuple[float, float]) -> Picture:
    """The canvas [H, W, 3], three times as large and pale, with each stroke as a line that begins with a dot."""
    height, width = canvas.shape[:2]
    large = cv2.resize(canvas, (_LARGER * width, _LARGER * height), interpolation=cv2.INTER_LINEAR)
    picture = np.ascontiguousarray(127 + large // 2)
    window, scale = (0.0, 0.0, *canvas_size_m), picture.shape[1] / canvas_size_m[0]
    for stroke in strokes:
        places = canvas_to_pixel(stroke.path[:, 1:3], window, scale)
        fixed = np.rint(places * 2**_SUBPIXEL).astype(np.int32)
        cv2.polylines(picture, [fixed.reshape(-1, 1, 2)], False, _LINE, 2, cv2.LINE_AA, _SUBPIXEL)
        column, row = (int(value) for value in fixed[0])
        cv2.circle(picture, (column, row), 5 << _SUBPIXEL, _START, -1, cv2.LINE_AA, _SUBPIXEL)
    return np.asarray(picture, dtype=np.uint8)
