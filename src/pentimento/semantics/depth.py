"""Depth of a picture by a published model: a goal for sculpting."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from transformers import AutoImageProcessor, AutoModelForDepthEstimation

from pentimento.contracts.errors import ConfigError
from pentimento.planning.pushes.goal import GoalError
from pentimento.semantics.pretrained import load_pretrained, unreadable

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]


def depth_relief(picture: Image, folder: Path) -> FloatArray:
    """Near is high: depth [h, w] of a picture, sRGB [h, w, 3], by a depth model of transformers in a local folder.

    Models of relative depth predict inverse depth, models of metric depth metres; both are converted to heights.

    Raises:
        GoalError: the folder holds no such model, or its depth is constant or not finite.
    """
    try:
        model = load_pretrained(AutoModelForDepthEstimation, folder, "The depth model")
        with unreadable(f"The image processor in {folder}"):
            processor = AutoImageProcessor.from_pretrained(folder, local_files_only=True)
    except ConfigError as error:
        raise GoalError(
            f"{folder} holds no depth model of transformers ({error}); save model and image processor there with "
            "save_pretrained, or choose the plain relief."
        ) from error
    with torch.no_grad():
        depth_map = model(**processor(images=picture, return_tensors="pt")).predicted_depth[0].double().numpy()
    if not np.isfinite(depth_map).all() or np.ptp(depth_map) == 0:
        raise GoalError(f"The depth model of {folder} sees no depth in this picture; choose the plain relief.")
    metric = getattr(model.config, "depth_estimation_type", "relative") == "metric"
    depth = cv2.resize(depth_map, (picture.shape[1], picture.shape[0]), interpolation=cv2.INTER_LINEAR)
    return np.asarray(-depth if metric else depth, dtype=np.float64)
