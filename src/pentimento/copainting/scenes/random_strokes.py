"""Random strokes on paper, as a robot's canvas may hold them, whatever they mean."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

_FINER: Final = 4  # drawn at this many times the size and averaged down: soft edges at any width
_SHIFT: Final = 4  # OpenCV's fixed-point bits of a coordinate
_DARK_SHARE: Final = 0.7  # of the pictures; the others have one ink of any colour


def random_strokes(
    side_px: int, strokes: int, width_px: tuple[float, float], generator: np.random.Generator
) -> NDArray[np.uint8]:
    """Arcs of one ink on light paper, sRGB [side, side, 3]; each stroke's width is uniform within `width_px`."""
    size = side_px * _FINER
    cover = np.zeros((size, size), np.uint8)
    t = np.linspace(-1, 1, 16)[:, None]
    for _ in range(strokes):
        middle, angle = generator.uniform(0, side_px, 2), generator.uniform(0, np.pi)
        half, bend = generator.uniform(0.04, 0.25) * side_px, generator.normal(0, 0.15) * side_px
        along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
        points = middle + along * t * half + across * (1 - t**2) * bend
        fixed_point = np.round(points * _FINER * 2**_SHIFT).astype(np.int32)
        width = max(1, round(generator.uniform(*width_px) * _FINER))
        cv2.polylines(cover, [fixed_point], False, 1, width, shift=_SHIFT)
    dark = generator.random() < _DARK_SHARE
    ink = np.full(3, generator.uniform(0, 0.2)) if dark else generator.uniform(0, 0.8, 3)
    paper = generator.uniform(0.88, 1.0)
    share = cv2.resize(cover.astype(np.float32), (side_px, side_px), interpolation=cv2.INTER_AREA)[..., None]
    return np.round(255 * (paper + (ink - paper) * share)).astype(np.uint8)
