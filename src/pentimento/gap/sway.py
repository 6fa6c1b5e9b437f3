"""Random effects of actions: how each differs from every model as a whole, by amounts that scatter.

What is left of an action is not noise pixel by pixel but for the most part a sum of few ways in which it can differ
(Laird and Ware 1982):  r = J beta + M u + e  with u ~ N(0, T) and e ~ N(0, s^2 1).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_ROUNDS = 30
_OF_ITSELF = 0.05
"""Share of a direction that the ways must leave for it to tell something."""
_LEAST_EIGENVALUE = 1e-10
"""Of the largest."""
_STRONG = 0.9
"""Quantile over directions: what a cause does is as smooth as the smoothest of them."""


def inverse_root(matrices: Array) -> Array:
    """R [B, K, K] with R R^T the inverse of symmetric positive matrices [B, K, K], be they so but for rounding."""
    values, vectors = np.linalg.eigh((matrices + matrices.swapaxes(-1, -2)) / 2)
    values = np.maximum(values, _LEAST_EIGENVALUE * values[:, -1:])
    return np.asarray(vectors / np.sqrt(values)[:, None, :])


def random_effects(overlap: Array, pull: Array, energy: Array, pixels: Array) -> tuple[Array, float]:
    """Covariance T [K, K] of the amounts and the variance s^2 of each pixel, by expectation maximisation.

    Args:
        overlap: M^T M of each stroke, [n, K, K].
        pull: M^T r, [n, K].
        energy: r^T r, [n].
        pixels: how many numbers r has, [n].
    """
    ways = pull.shape[1]
    spread, noise = np.eye(ways), float(energy.sum() / pixels.sum())
    for _ in range(_ROUNDS):
        covariance = np.linalg.inv(np.linalg.inv(spread) + overlap / noise)  # of u given r
        mean = np.einsum("nkj,nj->nk", covariance, pull) / noise
        spread = (mean[:, :, None] * mean[:, None, :] + covariance).mean(0) + 1e-8 * np.eye(ways)
        left = energy - 2 * (mean * pull).sum(1) + np.einsum("nk,nkj,nj->n", mean, overlap, mean)
        left += np.einsum("nkj,njk->n", overlap, covariance)
        noise = float(left.sum() / pixels.sum())
    return spread, noise


def alikeness(curvature: Array, slope: Array, noise: float, ways: int) -> float:
    """How many numbers of a residual say the same: what the ways leave of it is not white, for neighbouring pixels and
    the three channels err alike. The variance along the model's own directions, over that of white noise.
    """
    n, own = slope.shape[1] - ways, slice(-ways, None)
    across = curvature[:, :n, own] @ np.linalg.pinv(curvature[:, own, own], hermitian=True)
    rest = slope[:, :n] - np.einsum("npk,nk->np", across, slope[:, own])
    diagonal = np.einsum("npp->np", curvature[:, :n, :n])
    left = diagonal - np.einsum("npk,npk->np", across, curvature[:, :n, own])
    seen = left > _OF_ITSELF * np.maximum(diagonal, 1e-12)
    ratios = [(rest[s, p] ** 2 / left[s, p]).mean() / noise for p in range(n) if (s := seen[:, p]).sum() > len(s) // 4]
    value = float(np.quantile(ratios, _STRONG)) if ratios else 1.0
    return max(value, 1.0)
