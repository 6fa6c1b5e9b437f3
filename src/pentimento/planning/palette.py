"""A palette that a person can mix: the plan's colours clustered in Lab (thesis 4.3.5, Figure 4.6)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from sklearn.cluster import KMeans

from pentimento.contracts.colour import lab_to_srgb, srgb_to_lab

FloatArray = NDArray[np.float64]


def cluster_palette(
    colors_srgb: FloatArray, weights: FloatArray, size: int, seed: int
) -> tuple[FloatArray, NDArray[np.int64]]:
    """K-means in L*a*b*.

    Args:
        colors_srgb: [S, 3].
        weights: [S], how much each colour counts: the area that its stroke covers.
        size: paints wanted; fewer come back where there are fewer distinct colours.

    Returns:
        The palette, sRGB [K, 3], from light to dark; and which paint each colour takes, [S].
    """
    lab = srgb_to_lab(np.asarray(colors_srgb, dtype=np.float64))
    size = min(size, len(np.unique(lab.round(6), axis=0)))
    found = KMeans(size, n_init=4, random_state=seed).fit(lab, sample_weight=weights)
    light_first = np.argsort(-found.cluster_centers_[:, 0], kind="stable")
    rank = np.argsort(light_first)
    palette = np.clip(lab_to_srgb(found.cluster_centers_[light_first]), 0.0, 1.0)
    return palette, rank[found.labels_].astype(np.int64)
