"""Whether a row's photographs changed along its path: where many did not, paths and pictures do not belong together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import cv2
import numpy as np

from pentimento.contracts.frames import canvas_to_pixel
from pentimento.contracts.images import decode_png

NEAR_M: Final = 0.002
_CHANGE: Final = 25
"""Difference of a channel, of 255, from which on a pixel counts as inked."""
_SHARE: Final = 0.25
"""Of the path, which must lie near ink."""
_PLACES: Final = 32
"""Along the path at which ink is looked for, evenly by length."""


def has_ink(row: Mapping[str, Any]) -> bool:
    """Whether ink lies within ``NEAR_M`` of a quarter of the path of a row of the strokes contract."""
    before, after = (decode_png(row[name]["bytes"]).astype(np.int16) for name in ("before", "after"))
    change = np.abs(after - before).reshape(*before.shape[:2], -1).max(-1)
    window = row["window_m"]
    pixels_per_m = change.shape[1] / (window[2] - window[0])
    reach = max(round(NEAR_M * pixels_per_m), 1)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    near = cv2.dilate((change > _CHANGE).astype(np.uint8), disc)
    path = np.array(row["path"])[:, 1:3]
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    places = np.linspace(0, length[-1], _PLACES)
    points = np.stack([np.interp(places, length, path[:, axis]) for axis in (0, 1)], axis=1)
    column, line = np.rint(canvas_to_pixel(points, window, pixels_per_m)).astype(int).T
    height, width = near.shape
    return float(near[line.clip(0, height - 1), column.clip(0, width - 1)].mean()) >= _SHARE
