"""Scores of candidate causes from sums by action, held-out gains, and the paired test of two models.

The action is the unit, because pixels of one action share their errors. At the fitted model the projected score of a
candidate is s_i = g_ic - A_cb A_bb^-1 g_ib for each action, with the nuisances b projected out.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.gauss_newton import Statistics

Array = NDArray[Any]

_RIDGE = 1e-6
"""Relative ridge of linear systems."""
_FOLDS = 6
"""Folds of blocks for held-out gains."""
_SIGN_FLIPS = 4999
"""Draws of a paired test."""


def projected_scores(statistics: Statistics, nuisances: Array, candidate: Array) -> Array:
    """Scores [n, Q] of a candidate's parameters with the nuisances projected out."""
    pull = _nuisance_response(statistics, nuisances, candidate)
    projected: Array = statistics.slope[:, candidate] - statistics.slope[:, nuisances] @ pull
    return projected


def projected_statistics(statistics: Statistics, nuisances: Array, candidate: Array) -> tuple[Array, Array]:
    """Slope [n, Q] and curvature [n, Q, Q] of each action in a candidate's parameters, nuisances projected out."""
    pull = _nuisance_response(statistics, nuisances, candidate)
    slope = statistics.slope[:, candidate] - statistics.slope[:, nuisances] @ pull
    absorbed = pull.T @ statistics.curvature[:, nuisances][:, :, candidate]
    curvature = statistics.curvature[:, candidate][:, :, candidate] - absorbed - absorbed.swapaxes(1, 2)
    curvature += pull.T @ statistics.curvature[:, nuisances][:, :, nuisances] @ pull
    return slope, curvature


def _nuisance_response(statistics: Statistics, nuisances: Array, candidate: Array) -> Array:
    """Change of the nuisances per change of the candidate's parameters, [nuisances, candidate]."""
    curvature = statistics.curvature.sum(0)
    held = curvature[np.ix_(nuisances, nuisances)]
    return np.asarray(np.linalg.lstsq(_ridged(held), curvature[np.ix_(nuisances, candidate)], rcond=None)[0])


def held_out_gains(statistics: Statistics, nuisances: Array, candidate: Array, *, block: Array, seed: int) -> Array:
    """By how much the candidate lowers each action's error [n] when it is fitted to the other folds.

    To second order about the fitted model. The nuisances are projected out once, over all actions, because refits
    within a fold would move along directions that few actions determine.
    """
    fold = folds(block, seed)
    slope, curvature = projected_statistics(statistics, nuisances, candidate)
    gains = np.zeros(len(block))
    for k in range(_FOLDS):
        out = fold == k
        if out.all() or not out.any():
            continue
        known, pulls = curvature[~out].sum(0), slope[~out]
        # A ridge of the size of the noise: directions without information are not fitted to noise.
        noise = np.square(pulls).sum() / max(np.trace(known), 1e-300)
        step = np.linalg.lstsq(_ridged(known) + noise * np.eye(len(known)), pulls.sum(0), rcond=None)[0]
        gains[out] = 2 * slope[out] @ step - np.einsum("p,npq,q->n", step, curvature[out], step)
    return gains


def folds(block: Array, seed: int) -> Array:
    """Fold number of each action, int[n]; a block is never split."""
    blocks = np.unique(block)
    fold_of = dict(zip(blocks, np.random.default_rng([seed, 2]).permutation(len(blocks)) % _FOLDS, strict=True))
    return np.array([fold_of[b] for b in block])


def _ridged(curvature: Array) -> Array:
    diagonal = np.diag(curvature)
    return curvature + np.diag(_RIDGE * diagonal + 1e-15)


def paired_p(differences: Array, seed: int) -> float:
    """One-sided p that the mean of ``differences`` [n] is not above 0, by sign flips."""
    n = len(differences)
    signs = np.random.default_rng([seed, 5]).choice((-1.0, 1.0), (_SIGN_FLIPS, n))
    observed = differences.mean() / max(differences.std(), 1e-300)
    flipped = signs * differences
    drawn = flipped.mean(1) / np.maximum(flipped.std(1), 1e-300)
    return float((1 + (drawn >= observed).sum()) / (_SIGN_FLIPS + 1))
