"""Rivals of TrajVAE that are simpler: what else gives new strokes from few."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

KEPT = 0.95
"""Of the variance, in the Gaussian sampler's components."""
NOISE = 0.03
"""Of copies: standard deviation as a share of the stroke's extent."""
WAVES = 3


def gaussian(few_m: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """Strokes [count, N, 2] of a normal distribution along the principal components of few strokes [K, N, 2]."""
    flat = few_m.reshape(len(few_m), -1)
    mean = flat.mean(0)
    _, singular, axes = np.linalg.svd(flat - mean, full_matrices=False)
    share = np.cumsum(singular**2) / max(float((singular**2).sum()), 1e-30)
    kept = int(np.searchsorted(share, KEPT)) + 1
    deviation = singular[:kept] / np.sqrt(max(len(flat) - 1, 1))
    drawn = mean + (rng.standard_normal((count, len(deviation))) * deviation) @ axes[: len(deviation)]
    return np.asarray(drawn.reshape(count, *few_m.shape[1:]))


def copies(few_m: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """Strokes [count, N, 2]: each a copy of one of few, [K, N, 2], with smooth noise that leaves its ends."""
    chosen = few_m[rng.integers(len(few_m), size=count)]
    extent = np.ptp(chosen, axis=1).max(1)
    t = np.linspace(0, np.pi, few_m.shape[1])
    waves = np.stack([np.sin(n * t) / n for n in range(1, WAVES + 1)])
    noise = np.einsum("snd,np->spd", rng.standard_normal((count, WAVES, 2)), waves)
    return np.asarray(chosen + NOISE * extent[:, None, None] * noise)
