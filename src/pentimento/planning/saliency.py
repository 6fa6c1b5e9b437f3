"""Where a picture stands out: frequency-tuned saliency (Achanta, Hemami, Estrada & Süsstrunk, CVPR 2009)."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb, srgb_to_lab

FloatArray = NDArray[np.float64]


def saliency(picture: FloatArray) -> FloatArray:
    """[H, W], mean 1: how far each place's colour in L*a*b* is from the picture's mean; 1 everywhere in a flat one.

    Args:
        picture: [H, W, 3], linear light.
    """
    soft = np.clip(np.asarray(cv2.GaussianBlur(picture, (5, 5), 0), dtype=np.float64), 0.0, 1.0)
    lab = srgb_to_lab(linear_to_srgb(soft))
    distance = np.linalg.norm(lab - lab.mean((0, 1)), axis=-1)
    mean = float(distance.mean())
    return np.asarray(distance / mean) if mean > 1e-6 else np.ones(picture.shape[:2])
