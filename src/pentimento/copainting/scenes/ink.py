"""Ink: where a drawing in one dark ink is inked, and how much of it survives."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

REACH_PX: Final = 1
"""Ink that moved by no more than this has survived."""


def ink_mask(picture: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """The inked pixels [..., H, W] of drawings [..., H, W, 3]: darker than half of a white paper's sRGB grey."""
    grey: NDArray[np.bool_] = picture.astype(np.float32).mean(-1) < 127.5
    return grey


def ink_recall(drawing: NDArray[np.uint8], picture: NDArray[np.uint8], reach_px: int = REACH_PX) -> float:
    """Share of a drawing's ink that a picture still shows, within `reach_px` (NaN where the drawing has none).

    Both are uint8 [H, W, 3], or [B, H, W, 3] for the share over all ink of the batch together.
    """
    before, after = (ink_mask(np.atleast_3d(p)).reshape(-1, *p.shape[-3:-1]) for p in (drawing, picture))
    reach = np.ones((2 * reach_px + 1, 2 * reach_px + 1), np.uint8)
    near = np.stack([cv2.dilate(mask.astype(np.uint8), reach) for mask in after]).astype(bool)
    inked = int(before.sum())
    return float((before & near).sum() / inked) if inked else float("nan")
