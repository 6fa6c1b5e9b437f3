"""A picture as a pen can draw it: contours in black, and what is dark in thin tones."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb, srgb_to_linear
from pentimento.contracts.ranges import above_zero, at_least

FloatArray = NDArray[np.float64]

_WIDER = 4.0
"""The surroundings that a line is darker than, as a multiple of its width."""
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True)
class InkTones:
    """How a picture is turned into ink."""

    line_m: float
    """Width of the Gaussian that contours are found with; about half a pen's stroke."""
    contrast: float
    """Lightness below its surroundings at which a contour is wholly black; the lower, the more contours."""
    tone: float
    """Share of the darkness of surfaces that stays: 0 for contours only, 1 for the picture's own tones."""

    def __post_init__(self) -> None:
        above_zero(self, "line_m", "contrast")
        at_least(self, 0, "tone")
        if self.tone > 1:
            raise ValueError(f"tone is {self.tone}; it is a share, at most 1.")


def ink_tones(picture: FloatArray, pixels_per_m: float, config: InkTones) -> FloatArray:
    """The darkness that ink is to make, as grey linear light [H, W, 3]; of a picture [H, W, 3] in linear light.

    Contours are a difference of Gaussians of lightness, its dark side (Winnemöller, Kyprianidis and Olsen 2012): so
    that a few dozen lines say what a picture shows, and a tinted ground stays white. Lightness is stretched over the
    picture's own 2nd to 98th percentile; a picture of one tone keeps it.
    """
    lightness = linear_to_srgb(np.clip(picture @ _LUMINANCE, 0.0, 1.0))
    low, high = np.percentile(lightness, [2, 98])
    if high - low > 1e-3:
        lightness = np.clip((lightness - low) / (high - low), 0.0, 1.0)
    width_px = config.line_m * pixels_per_m
    near, far = (cv2.GaussianBlur(lightness, (0, 0), width) for width in (width_px, _WIDER * width_px))
    contour = np.clip((far - near) / config.contrast, 0.0, 1.0)
    tones = np.minimum(1 - contour, 1 - config.tone * (1 - lightness))
    return np.repeat(srgb_to_linear(tones)[..., None], 3, axis=-1)
