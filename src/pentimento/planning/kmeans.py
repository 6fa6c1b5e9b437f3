"""K-means with weights (Lloyd 1982), started by greedy k-means++ (Arthur & Vassilvitskii 2007)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_STARTS = 4
_MAX = 300
_SETTLED = 1e-4
"""Of the points' variance: centres that moved by less than this, squared, stay."""


def weighted_kmeans(points: FloatArray, weights: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """[K, D] centres of ``count`` clusters: the best of several starts.

    Args:
        points: [S, D], of which at least ``count`` differ.
        weights: [S], above 0: how much each point counts.
    """
    found = [_lloyd(points, weights, _spread_start(points, weights, count, rng)) for _ in range(_STARTS)]
    return min(found, key=lambda centres: float(weights @ _squares(points, centres).min(1)))


def _lloyd(points: FloatArray, weights: FloatArray, centres: FloatArray) -> FloatArray:
    settled = _SETTLED * points.var(0).mean()
    for _ in range(_MAX):
        squares = _squares(points, centres)
        nearest = squares.argmin(1)
        mass = np.bincount(nearest, weights, len(centres))
        sums = np.stack([np.bincount(nearest, weights * column, len(centres)) for column in points.T], axis=1)
        # A centre that nothing is nearest to goes where the points are served worst.
        worst = points[np.argsort(-weights * squares.min(1), kind="stable")[: len(centres)]]
        moved = np.where(mass[:, None] > 0, sums / np.maximum(mass, 1e-300)[:, None], worst)
        shift, centres = np.square(moved - centres).sum(), moved
        if shift <= settled:
            break
    return centres


def _spread_start(points: FloatArray, weights: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """Points far apart: each is the best of a few drawn in proportion to their squared distance to those before."""
    tries = 2 + int(np.log(count))
    first = rng.choice(len(points), p=weights / weights.sum())
    chosen, left = [points[first]], np.square(points - points[first]).sum(1)
    for _ in range(count - 1):
        potential = weights * left
        drawn = rng.choice(len(points), tries, p=potential / potential.sum())
        after = np.minimum(left, _squares(points, points[drawn]).T)
        best = int((after @ weights).argmin())
        chosen.append(points[drawn[best]])
        left = after[best]
    return np.array(chosen)


def _squares(points: FloatArray, centres: FloatArray) -> FloatArray:
    """[S, K] squared distances."""
    squares = np.square(points).sum(1)[:, None] - 2 * points @ centres.T + np.square(centres).sum(1)
    return np.asarray(np.maximum(squares, 0.0))
