"""Scenes as people draw them with a pen: contours on paper, some with a little tone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb, srgb_to_linear
from pentimento.copainting.scenes.ink_tones import InkTones, ink_tones

_FINER: Final = 2  # drawn at this many times the size and averaged down
_REACH_PX: Final = 2  # of a contour beyond its thing's region


@dataclass(frozen=True)
class Pen:
    """A hand's pen and manner."""

    width: float
    """Of its lines, as a share of the picture's side."""
    contrast: float
    """As in ``InkTones``."""
    tone: float
    """As in ``InkTones``: 0 draws contours only."""
    ink: float
    """The ink's sRGB grey."""
    paper: float
    """The paper's sRGB grey."""


def random_pen(generator: np.random.Generator) -> Pen:
    """Thin to broad, black to dark grey; half of the hands shade."""
    tone = float(generator.uniform(0.1, 0.4)) if generator.random() < 0.5 else 0.0
    return Pen(
        float(generator.uniform(0.007, 0.011)), float(generator.uniform(0.1, 0.25)), tone,
        float(generator.uniform(0, 0.15)), float(generator.uniform(0.95, 1.0)),
    )  # fmt: skip


def pen_drawing(picture: NDArray[np.uint8], drawn: NDArray[np.bool_], pen: Pen) -> NDArray[np.uint8]:
    """What of a picture, sRGB [H, W, 3], lies within `drawn` [H, W] or close about it, in ink; the rest is paper."""
    height, width = picture.shape[:2]
    large = cv2.resize(picture, (width * _FINER, height * _FINER), interpolation=cv2.INTER_CUBIC)
    lit = srgb_to_linear(large.astype(np.float64) / 255)
    # On a sheet one metre wide, widths in metres are shares of the picture's side.
    tones = ink_tones(lit, float(width * _FINER), InkTones(pen.width, pen.contrast, pen.tone))
    light = cv2.resize(linear_to_srgb(tones[..., 0]), (width, height), interpolation=cv2.INTER_AREA)
    near = cv2.dilate(drawn.astype(np.uint8), np.ones((2 * _REACH_PX + 1,) * 2, np.uint8)) > 0
    grey = pen.ink + (pen.paper - pen.ink) * np.where(near, light, 1.0)
    return np.repeat(np.round(255 * grey).astype(np.uint8)[..., None], 3, axis=-1)
