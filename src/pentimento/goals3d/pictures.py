"""Reliefs from pictures: plain ones from their light, or depth as a network sees it (thesis 7.3.5, Figure 7.10)."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import srgb_to_linear, to_float
from pentimento.planning.pushes.goal import GoalError

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
_SMOOTH = 0.01


def plain_relief(picture: Image) -> FloatArray:
    """Bright is high: the lightness [h, w] of a picture, sRGB [h, w, 3], smoothed by a hundredth of its longer side."""
    luminance = srgb_to_linear(to_float(picture).astype(np.float64)) @ _LUMINANCE
    smooth = cv2.GaussianBlur(luminance, (0, 0), max(_SMOOTH * max(luminance.shape), 0.5))
    return np.asarray(np.cbrt(np.clip(smooth, 0.0, 1.0)))  # as light as it looks, nearly CIE L*


def depth_relief(picture: Image, folder: Path) -> FloatArray:
    """Near is high: the depth [h, w] of a picture, sRGB [h, w, 3], by a depth model of transformers in a local folder.

    Models of relative depth give inverse depth, of metric depth metres; both are turned to heights.

    Raises:
        GoalError: the folder holds no such model, or it sees no depth.
    """
    import torch
    from transformers import AutoImageProcessor, AutoModelForDepthEstimation

    try:
        processor = AutoImageProcessor.from_pretrained(folder, local_files_only=True)
        model = AutoModelForDepthEstimation.from_pretrained(folder, local_files_only=True).eval()
    except (OSError, ValueError, KeyError) as error:
        first = str(error).splitlines()[0]
        raise GoalError(
            f"{folder} holds no depth model of transformers ({first}); save model and image processor there with "
            "save_pretrained, or choose the plain relief."
        ) from error
    with torch.no_grad():
        seen = model(**processor(images=picture, return_tensors="pt")).predicted_depth[0].double().numpy()
    if not np.isfinite(seen).all() or np.ptp(seen) == 0:
        raise GoalError(f"The depth model of {folder} sees no depth in this picture; choose the plain relief.")
    metric = getattr(model.config, "depth_estimation_type", "relative") == "metric"
    depth = cv2.resize(seen, (picture.shape[1], picture.shape[0]), interpolation=cv2.INTER_LINEAR)
    return np.asarray(-depth if metric else depth, dtype=np.float64)
