"""Distances between height maps as point clouds (thesis 7.3.4): Chamfer and Earth Mover's, after thinning by voxels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

Array = NDArray[np.float64]


def cloud(height_m: NDArray[Any], known: NDArray[np.bool_], pixels_per_m: float) -> Array:
    """[P, 3] points in metres of the known pixels of a height map [H, W]; x along columns, y up."""
    row, column = np.nonzero(known)
    return np.stack([column / pixels_per_m, -row / pixels_per_m, height_m[row, column]], axis=1).astype(np.float64)


def thinned(points: Array, voxel_m: float, center_m: Array) -> Array:
    """One point for each voxel that holds any: the mean of those in it.

    A voxel's middle is at ``center_m`` [3]; on the surface's height, noise does not split the surface in two layers.
    """
    _, index = np.unique(np.floor((points - center_m) / voxel_m + 0.5).astype(np.int64), axis=0, return_inverse=True)
    index = index.reshape(-1)
    count = np.bincount(index)
    return np.stack([np.bincount(index, points[:, axis]) / count for axis in range(3)], axis=1)


def chamfer(one: Array, other: Array) -> float:
    """Mean distance from each point to the nearest of the other cloud, summed over both directions, in metres."""
    there, back = cKDTree(other).query(one)[0], cKDTree(one).query(other)[0]
    return float(there.mean() + back.mean())


def earth_movers(one: Array, other: Array, seed: int = 0) -> float:
    """Mean distance over the best pairing of points, in metres; the larger cloud is drawn down to the size of the
    smaller."""
    rng = np.random.default_rng(seed)
    size = min(len(one), len(other))
    one, other = (c if len(c) == size else c[np.sort(rng.permutation(len(c))[:size])] for c in (one, other))
    ways = np.linalg.norm(one[:, None] - other[None], axis=2)
    return float(ways[linear_sum_assignment(ways)].mean())
