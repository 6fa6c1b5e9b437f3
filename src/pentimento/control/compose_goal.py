"""What a goal planner leaves as it is stays the canvas, to the pixel.

A goal planner redraws the whole picture from latents: what it does not mean to change comes back nearly as it was, and
a planner of strokes would try to draw the difference. But the canvas is known, and so is what the autoencoder alone
makes of it. Where the completion is that, the canvas itself is the goal.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

Pictures = NDArray[np.uint8]

_UNMEANT: Final = 8
"""A difference in levels of 255, seen through the blur, up to which nothing is to change."""
_MEANT: Final = 32
"""From here on all is the completion's; between the two its share rises."""
_BLUR: Final = 0.25
"""Standard deviation, as a share of a place of the latents: a line that is redrawn a little beside itself is none."""
_REACH: Final = 0.5
"""How far about a change all is the completion's, as a share of a place: up to the rim of what it draws."""


def keep_canvas(canvas: Pictures, completion: Pictures, again: Pictures, place_px: float) -> Pictures:
    """Goals: the completion where it differs from the canvas as the autoencoder knows it, elsewhere the canvas.

    For any medium: paint that is to cover other paint differs from it, too. All pictures are uint8 [B, H, W, 3].

    Args:
        canvas: what was to be completed.
        completion: what the goal planner made of it.
        again: the canvas as it comes back from the planner's autoencoder, encoded and decoded.
        place_px: side of the square of pixels that a place of the latents stands for.
    """
    reach = np.ones((2 * round(_REACH * place_px) + 1,) * 2, np.uint8)
    goals = np.empty_like(canvas)
    for goal, before, made, known in zip(goals, canvas, completion, again, strict=True):
        change = made.astype(np.float32) - known
        seen = np.abs(cv2.GaussianBlur(change, (0, 0), _BLUR * place_px)).max(-1)
        share = cv2.dilate(np.clip((seen - _UNMEANT) / (_MEANT - _UNMEANT), 0, 1), reach)[..., None]
        goal[:] = np.round(before + share * (made.astype(np.float32) - before))
    return goals
