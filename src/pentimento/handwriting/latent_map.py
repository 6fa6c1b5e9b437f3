"""A map of the latent space: t-SNE, with the strokes drawn where they lie (thesis Figure 5.8)."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from sklearn.manifold import TSNE

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]

COLOURS = ((31, 119, 180), (214, 39, 40), (44, 160, 44), (148, 103, 189), (230, 126, 34), (23, 160, 170), (120, 90, 60))
"""Of hands, sRGB, in turn."""
_SIDE_PX = 900
_STROKE_PX = 34
_FINE = 4


def flat_map(latents: FloatArray, seed: int) -> FloatArray:
    """[S, 2] of latents [S, L], by t-SNE."""
    perplexity = min(30.0, (len(latents) - 1) / 3)
    tsne = TSNE(perplexity=perplexity, init="pca", random_state=seed, n_jobs=1)
    return np.asarray(tsne.fit_transform(latents), dtype=np.float64)


def nearest_of_same_hand(latents: FloatArray, hands: Sequence[str]) -> float:
    """The share of strokes whose nearest neighbour is of their own hand."""
    square = np.square(latents).sum(1)
    distance = square[:, None] + square - 2 * latents @ latents.T
    np.fill_diagonal(distance, np.inf)
    nearest = distance.argmin(1)
    return float(np.mean([hands[i] == hands[j] for i, j in enumerate(nearest)]))


def drawn_map(places: FloatArray, paths_m: FloatArray, hands: Sequence[str]) -> Image:
    """Strokes [S, N, 2] at places [S, 2], in a colour for each hand, all at one scale: sRGB [H, W, 3]."""
    image = np.full((_SIDE_PX, _SIDE_PX, 3), 255, np.uint8)
    low, high = places.min(0), places.max(0)
    inside = (places - low) / np.maximum(high - low, 1e-9)
    at = _STROKE_PX + inside * (_SIDE_PX - 2 * _STROKE_PX)
    extent = np.ptp(paths_m, axis=1).max(1)
    scale = _STROKE_PX / np.quantile(extent, 0.9)
    order = list(dict.fromkeys(hands))
    for place, path, hand in zip(at, paths_m, hands, strict=True):
        line = (path - path.mean(0)) * scale
        points = np.column_stack([place[0] + line[:, 0], _SIDE_PX - place[1] - line[:, 1]])
        colour = COLOURS[order.index(hand) % len(COLOURS)]
        cv2.polylines(image, [np.rint(points * 2**_FINE).astype(np.int32)], False, colour, 1, cv2.LINE_AA, _FINE)
    return image
