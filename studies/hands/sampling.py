"""New strokes of a hand: latents between those of few strokes, with what the decoder leaves unsaid.

A decoder gives the mean of the strokes that a latent stands for; people's strokes scatter about it. What the mean of a
stroke leaves out, such as a tremor, is laid on the strokes that are drawn near it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.metrics import roc_auc_score
from sklearn.model_selection import StratifiedKFold, cross_val_predict

from pentimento.handwriting.evaluation import TREES, even_path, features
from pentimento.handwriting.recording import standardise
from pentimento.handwriting.trajvae import Strokes, TrajVAE, decoder_of

FloatArray = NDArray[np.float64]

_NEIGHBOURS = 4
"""Of each stroke, among the few: how these differ from it is how it may vary."""


def sampled_strokes(model: TrajVAE, few: Strokes, count: int, rng: np.random.Generator) -> FloatArray:
    """Strokes [count, N, 2], metres, in the standard frame, like the few.

    Latents are those of one of the few, moved at random along the ways to its nearest neighbours: a kernel estimate of
    their density with a covariance for each stroke (Terrell & Scott 1992, Variable kernel density estimation), so that
    lines vary as lines do and scribbles as scribbles.
    """
    hand = decoder_of(model, few, "")
    known, latent = few.xy_m.double().numpy(), hand.latent_mean.astype(np.float64)
    apart = np.linalg.norm(latent[:, None] - latent, axis=-1)
    near = np.argsort(apart, axis=1, kind="stable")[:, 1 : _NEIGHBOURS + 1]
    ways = (latent[near] - latent[:, None]) / np.sqrt(max(near.shape[1], 1))  # [K, neighbours, L]
    k = rng.integers(len(latent), size=count)
    moved = np.einsum("sm,sml->sl", rng.standard_normal((count, near.shape[1])), ways[k])
    open_to = hand.latent_deviation[k] * rng.standard_normal((count, latent.shape[1]))
    drawn = hand.decode((latent[k] + moved + open_to).astype(np.float32))[0].astype(np.float64)
    left_out = known - hand.decode(hand.latent_mean)[0].astype(np.float64)
    larger = _sizes(drawn) / _sizes(known[k])
    return in_standard_frame(drawn + larger[:, None, None] * left_out[k])


def in_standard_frame(paths_m: FloatArray) -> FloatArray:
    """Paths [S, N, 2] as demonstrations are: from the origin to the x axis, at equal steps."""
    unknown = np.full((len(paths_m), paths_m.shape[1], 2), np.nan)
    points = np.concatenate([unknown[..., :1], paths_m, unknown], axis=-1)
    return np.stack([standardise(each, paths_m.shape[1])[0][:, 1:3] for each in points])


def _sizes(paths_m: FloatArray) -> FloatArray:
    """[S] root mean square distance of points from their middle."""
    return np.asarray(np.sqrt(np.square(paths_m - paths_m.mean(1, keepdims=True)).sum(-1).mean(-1)))


def difference_auc(one_m: Sequence[FloatArray], other_m: Sequence[FloatArray], seed: int, folds: int = 5) -> float:
    """How well trees tell two sets of standard paths [N, 2] apart, cross-validated: .5 not at all, 1 always.

    They see every coordinate besides the features of form, so that a sample that is too smooth, too even or of a
    wrong size is found out.
    """
    seen = np.vstack([np.column_stack([features(paths), _coordinates(paths)]) for paths in (one_m, other_m)])
    of_other = np.repeat([0, 1], [len(one_m), len(other_m)])
    trees = ExtraTreesClassifier(TREES, min_samples_leaf=2, random_state=seed, class_weight="balanced", n_jobs=1)
    split = StratifiedKFold(folds, shuffle=True, random_state=seed)
    result = cross_val_predict(trees, seen, of_other, cv=split, method="predict_proba")[:, 1]
    return float(roc_auc_score(of_other, result))


def _coordinates(paths_m: Sequence[FloatArray]) -> FloatArray:
    """[S, 4 N] places in millimetres, and steps in tenths."""
    even = np.stack([even_path(path) for path in paths_m]) * 1e3
    return np.column_stack([even.reshape(len(even), -1), 10 * np.diff(even, axis=1).reshape(len(even), -1)])
