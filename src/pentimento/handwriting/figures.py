"""Figures of demonstrations: sheets of strokes, and a t-SNE map of the latent space (thesis Figure 5.8)."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from sklearn.manifold import TSNE

from pentimento.handwriting.recording import XY
from pentimento.handwriting.repair import Repaired

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]

_CELL_PX = 96
_ACROSS = 12
_INK = (40, 40, 40)  # sRGB
_GONE = (200, 60, 40)  # of removed samples
_FINE = 4
"""Bits of the fraction of a pixel in OpenCV's coordinates."""


def sheet(paths: Sequence[FloatArray], size_m: float | None = None) -> Image:
    """Paths [N, 2] (metres), one per cell, at one scale: sRGB [H, W, 3]. ``size_m`` is a cell's size; None: the largest
    path's.
    """
    largest = max((float(np.ptp(path, axis=0).max()) for path in paths), default=1e-3)
    scale = 0.8 * _CELL_PX / max(size_m or largest, 1e-9)
    return _grid([_drawn(path, np.ones(len(path), dtype=bool), scale) for path in paths])


def sheet_of_repaired(repaired: Sequence[Repaired], largest: int = 48) -> Image:
    """The first ``largest`` repaired recordings, each at its own scale. Dropped samples are red."""
    cells = []
    for each in repaired[:largest]:
        known = np.isfinite(each.source.points[:, XY]).all(axis=1)
        path, kept = each.source.points[known][:, XY], ~each.removed[known]
        extent = float(np.ptp(path, axis=0).max()) if len(path) else 0.0
        cells.append(_drawn(path, kept, 0.8 * _CELL_PX / max(extent, 1e-6)))
    return _grid(cells)


def _drawn(path: FloatArray, kept: NDArray[np.bool_], scale: float) -> Image:
    cell = np.full((_CELL_PX, _CELL_PX, 3), 255, np.uint8)
    if len(path) == 0:
        return cell
    middle = (path.min(0) + path.max(0)) / 2
    places = np.rint(((path - middle) * [scale, -scale] + _CELL_PX / 2) * 2**_FINE).astype(np.int32)
    for a, b, whole in zip(places[:-1], places[1:], kept[:-1] & kept[1:], strict=True):
        cv2.line(cell, a.tolist(), b.tolist(), _INK if whole else _GONE, 1, cv2.LINE_AA, _FINE)
    for place in places[~kept]:
        cv2.circle(cell, place.tolist(), 2 << _FINE, _GONE, -1, cv2.LINE_AA, _FINE)
    return cell


def _grid(cells: list[Image]) -> Image:
    blank = np.full((_CELL_PX, _CELL_PX, 3), 255, np.uint8)
    cells = cells + [blank] * (-len(cells) % _ACROSS or (0 if cells else _ACROSS))
    rows = [np.hstack(cells[n : n + _ACROSS]) for n in range(0, len(cells), _ACROSS)]
    return np.vstack(rows)


COLOURS = ((31, 119, 180), (214, 39, 40), (44, 160, 44), (148, 103, 189), (230, 126, 34), (23, 160, 170), (120, 90, 60))
"""Colours of writers, sRGB, repeated from the first."""
_SIDE_PX = 900
_STROKE_PX = 34
_FINE = 4


def flat_map(latents: FloatArray, seed: int) -> FloatArray:
    """Places [S, 2] of latents [S, L], by t-SNE."""
    perplexity = min(30.0, (len(latents) - 1) / 3)
    tsne = TSNE(perplexity=perplexity, init="pca", random_state=seed, n_jobs=1)
    return np.asarray(tsne.fit_transform(latents), dtype=np.float64)


def drawn_map(places: FloatArray, paths_m: FloatArray, hands: Sequence[str]) -> Image:
    """Strokes [S, N, 2] at places [S, 2], in one colour per writer, all at one scale: sRGB [H, W, 3]."""
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
