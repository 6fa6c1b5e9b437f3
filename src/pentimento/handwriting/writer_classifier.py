"""Who drew a stroke: a classifier that knows demonstrations only, and a test whether two sets of strokes differ."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.metrics import roc_auc_score
from sklearn.model_selection import StratifiedKFold, cross_val_predict

from pentimento.handwriting.standard import resample

FloatArray = NDArray[np.float64]

_POINTS = 32
_TREES = 100
_TURNS = np.array([0.0, 0.05, 0.15, 0.3, 0.5, 0.8, 1.2, 2.0, np.pi])
"""Edges of the histogram of turns between neighbouring steps, radians."""


class StrokeClassifier:
    """Tells hands apart by the form and size of single strokes, wherever and however turned they lie."""

    def __init__(self, paths_m: Sequence[FloatArray], hands: Sequence[str], seed: int) -> None:
        """Train on paths [N, 2] of any number of points and the hand of each."""
        self.hands = tuple(dict.fromkeys(hands))
        self._trees = ExtraTreesClassifier(_TREES, min_samples_leaf=2, random_state=seed, n_jobs=1)
        self._trees.fit(features(paths_m), np.array([self.hands.index(hand) for hand in hands]))

    def shares(self, paths_m: Sequence[FloatArray]) -> FloatArray:
        """[hands] the share of the paths that is taken to be drawn by each hand."""
        told = self._trees.predict(features(paths_m))
        return np.bincount(told, minlength=len(self.hands)) / max(len(told), 1)


def difference_auc(one_m: Sequence[FloatArray], other_m: Sequence[FloatArray], seed: int, folds: int = 5) -> float:
    """How well trees tell two sets of standard paths [N, 2] apart, cross-validated: .5 not at all, 1 always.

    They see every coordinate besides the features of form, so that a sample that is too smooth, too even or of a
    wrong size is found out.
    """
    seen = np.vstack([np.column_stack([features(paths), _coordinates(paths)]) for paths in (one_m, other_m)])
    of_other = np.repeat([0, 1], [len(one_m), len(other_m)])
    trees = ExtraTreesClassifier(_TREES, min_samples_leaf=2, random_state=seed, class_weight="balanced", n_jobs=1)
    split = StratifiedKFold(folds, shuffle=True, random_state=seed)
    told = cross_val_predict(trees, seen, of_other, cv=split, method="predict_proba")[:, 1]
    return float(roc_auc_score(of_other, told))


def features(paths_m: Sequence[FloatArray]) -> FloatArray:
    """[S, F] of form and size; the same for a path and its mirror image, wherever it lies."""
    return np.stack([_features(_even(path)) for path in paths_m])


def _even(path: FloatArray) -> FloatArray:
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


def _coordinates(paths_m: Sequence[FloatArray]) -> FloatArray:
    """[S, 4 N] places in millimetres, and steps in tenths."""
    even = np.stack([_even(path) for path in paths_m]) * 1e3
    return np.column_stack([even.reshape(len(even), -1), 10 * np.diff(even, axis=1).reshape(len(even), -1)])
