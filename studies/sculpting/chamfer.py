"""Planning by Chamfer distance between point clouds: the baseline of the visual objective.

Clouds are down-sampled on a voxel grid, which makes the distance affordable (thesis 7.3.4, 7.4.2).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pentimento.contracts.frames import Window
from pentimento.planning.objectives import ClayObjective, Weights

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

_MM = 1e3


class ChamferObjective(ClayObjective):
    """The mean squared Chamfer distance in mm² takes the place of the weighted sum; it has no gradient here."""

    def __init__(self, goal_m: Array, window_m: Window, voxel_m: float) -> None:
        super().__init__(goal_m, window_m, Weights(1.0, 0.0))
        self._voxel_m = voxel_m
        self._cloud = self._points(goal_m)
        self._tree = cKDTree(self._cloud)

    def values(self, height_m: Array) -> FloatArray:
        """Of maps [..., H, W]."""
        maps = height_m.reshape(-1, *height_m.shape[-2:])
        return np.array([self._distance(each) for each in maps]).reshape(height_m.shape[:-2])

    def values_from(self, before_m: Array, after_m: Array) -> FloatArray:
        """Of maps [K, H, W]; points of the whole map count."""
        return self.values(after_m)

    def _distance(self, height_m: Array) -> float:
        cloud = self._points(height_m)
        there = self._tree.query(cloud)[0]
        back = cKDTree(cloud).query(self._cloud)[0]
        return float(_MM**2 * (np.square(there).mean() + np.square(back).mean()) / 2)

    def _points(self, height_m: Array) -> FloatArray:
        """[P, 3]: the mean of the surface's points in each voxel."""
        rows, columns = np.indices(height_m.shape)
        points = np.stack([columns / self.pixels_per_m, -rows / self.pixels_per_m, height_m], axis=-1).reshape(-1, 3)
        number = np.floor(points / self._voxel_m).astype(np.int64)
        number -= number.min(axis=0)
        _, voxel = np.unique(np.ravel_multi_index(tuple(number.T), tuple(number.max(axis=0) + 1)), return_inverse=True)
        count = np.bincount(voxel)
        return np.stack([np.bincount(voxel, axis) / count for axis in points.T], axis=1)
