"""Reliefs from point clouds: what lies on top, seen straight from above."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from pentimento.planning.pushes.goal import GoalError
from pentimento.planning.pushes.holes import fill_holes

FloatArray = NDArray[np.float64]

_MIN_POINTS = 50


def point_cloud_relief(points: FloatArray, side_px: int) -> FloatArray:
    """The highest of points [N, 3] (x right, y up, z towards the eye) in each pixel [h, w].

    The longer side has ``side_px``. Pixels without a point are filled from those around; outside the cloud's hull
    it is the lowest point's height.

    Raises:
        GoalError: too few points, values that are not finite, or a cloud on a line.
    """
    points = np.asarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < _MIN_POINTS:
        raise GoalError(f"A point cloud is [N, 3] with at least {_MIN_POINTS} points, not of shape {points.shape}.")
    if not np.isfinite(points).all():
        raise GoalError(
            f"{int((~np.isfinite(points)).any(axis=1).sum())} points of the cloud are not finite; drop them."
        )
    low, extent = points[:, :2].min(axis=0), np.ptp(points[:, :2], axis=0)
    try:
        hull = ConvexHull(points[:, :2]).equations
    except QhullError:
        raise GoalError("Seen from above, the point cloud lies on a line; turn it so that it shows a face.") from None
    k = side_px / extent.max()
    width, height = (max(int(np.ceil(side)), 2) for side in k * extent)
    columns = np.minimum(((points[:, 0] - low[0]) * k).astype(int), width - 1)
    rows = np.clip(height - 1 - ((points[:, 1] - low[1]) * k).astype(int), 0, height - 1)
    top = np.full((height, width), -np.inf)
    np.maximum.at(top, (rows, columns), points[:, 2])
    c, r = np.meshgrid(np.arange(width), np.arange(height))
    centres = np.stack([low[0] + (c + 0.5) / k, low[1] + (height - r - 0.5) / k], axis=-1)
    outside = (centres @ hull[:, :2].T + hull[:, 2] > 0.5 / k).any(axis=-1) & ~np.isfinite(top)
    top[outside] = points[:, 2].min()
    return fill_holes(np.where(np.isfinite(top), top, np.nan))[0]
