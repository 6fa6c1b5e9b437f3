"""Evaluation of handwriting styles: a classifier of writers, reconstruction errors, and nearest latents."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from sklearn.ensemble import ExtraTreesClassifier
from torch import Tensor

from pentimento.handwriting.recording import resample
from pentimento.handwriting.trajvae import Strokes, TrajVAE, reconstruction_errors_mm

FloatArray = NDArray[np.float64]

_POINTS = 32
TREES = 100
_TURNS = np.array([0.0, 0.05, 0.15, 0.3, 0.5, 0.8, 1.2, 2.0, np.pi])
"""Edges of the histogram of turning angles between successive steps, radians."""


class StrokeClassifier:
    """Classifies the writer of single strokes by form and size, independent of pose."""

    def __init__(self, paths_m: Sequence[FloatArray], hands: Sequence[str], seed: int) -> None:
        """Train on paths [N, 2] of any number of points, metres, and the writer of each."""
        self.hands = tuple(dict.fromkeys(hands))
        self._trees = ExtraTreesClassifier(TREES, min_samples_leaf=2, random_state=seed, n_jobs=1)
        self._trees.fit(features(paths_m), np.array([self.hands.index(hand) for hand in hands]))

    def shares(self, paths_m: Sequence[FloatArray]) -> FloatArray:
        """[writers] share of the paths that is classified as each writer's."""
        predicted = self._trees.predict(features(paths_m))
        return np.bincount(predicted, minlength=len(self.hands)) / max(len(predicted), 1)


def features(paths_m: Sequence[FloatArray]) -> FloatArray:
    """[S, F] features of form and size, invariant to translation, rotation and reflection."""
    return np.stack([_features(even_path(path)) for path in paths_m])


def even_path(path: FloatArray) -> FloatArray:
    padded = np.column_stack([np.zeros(len(path)), path])
    return resample(padded, _POINTS)[:, 1:3]


def _features(path: FloatArray) -> FloatArray:
    step = np.diff(path, axis=0)
    length = np.linalg.norm(step, axis=1).sum()
    heading = np.arctan2(step[:, 1], step[:, 0])
    turn = (np.diff(heading) + np.pi) % (2 * np.pi) - np.pi
    spread = np.sort(np.linalg.eigvalsh(np.cov(path.T)))[::-1]
    spread = np.sqrt(np.maximum(spread, 0.0))
    return np.array([
        np.log(length), np.linalg.norm(path[-1] - path[0]) / length, spread[0] / length, spread[1] / length,
        abs(turn.sum()), np.abs(turn).sum(), np.square(turn).sum(), np.abs(np.diff(turn)).sum(),
        *np.histogram(np.abs(turn), _TURNS)[0] / len(turn),
    ])  # fmt: skip


def reconstruction_mm(model: TrajVAE, strokes: Strokes) -> float:
    """Mean distance, mm, of points from their reconstruction from the strokes' mean latents."""
    return float(reconstruction_errors_mm(model, strokes).mean())


def nearest_mm(known: Strokes, strokes: Strokes) -> float:
    """The same for the baseline that reproduces the nearest known stroke."""
    apart = (strokes.xy_m[:, None] - known.xy_m).norm(dim=-1).mean(-1)
    return float(apart.min(1).values.mean() * 1e3)


def mean_stroke_mm(known: Strokes, strokes: Strokes) -> float:
    """The same for the baseline that reproduces the mean of the known strokes."""
    return distance_mm(known.xy_m.mean(0, keepdim=True).expand_as(strokes.xy_m), strokes.xy_m)


def distance_mm(one_m: Tensor, other_m: Tensor) -> float:
    """Mean distance, mm, between points [B, N, 2] in metres."""
    return float((one_m - other_m).norm(dim=-1).mean() * 1e3)


def nearest_of_same_hand(latents: FloatArray, hands: Sequence[str]) -> float:
    """Share of strokes whose nearest neighbour is by the same writer."""
    square = np.square(latents).sum(1)
    distance = square[:, None] + square - 2 * latents @ latents.T
    np.fill_diagonal(distance, np.inf)
    nearest = distance.argmin(1)
    return float(np.mean([hands[i] == hands[j] for i, j in enumerate(nearest)]))
