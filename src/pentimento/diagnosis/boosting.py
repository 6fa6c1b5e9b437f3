"""Cross-fitted gradient boosting for the learned residual model, and the part of it that resembles causes.

Each prediction for an action comes from trees that have not seen it (cross-fitting: Chernozhukov et al. 2018).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import get_num_threads
from numpy.typing import NDArray
from sklearn.ensemble import HistGradientBoostingRegressor

from pentimento.diagnosis.batches import one_openmp_thread
from pentimento.diagnosis.gauss_newton import Statistics
from pentimento.render.threads import in_threads

Array = NDArray[Any]

_FOLDS = 3
"""Folds of actions."""
_LEAVES = 64
"""Leaves of a tree."""
_PIXELS_A_LEAF = 30
"""Pixels of a leaf, at least."""
_RATE = 0.18
"""Learning rate."""
_BINS = 255
"""Bins of a feature."""
_CAUSE_RIDGE = 1e-4
"""Relative ridge of the projection on causes."""
_SURE_OF_CAUSE = 3.5
"""Standard errors from which the learned prediction counts as resembling a cause. The trees see no covariate of a cause
(speed, time, sheet). A chance association in the design must not enter the prediction, since it would stand out as an
effect."""


class Trees(NamedTuple):
    """Boosted trees on binned features [n, F]. The regressor's own binning with weights takes four times as long."""

    edges: Array  # [F, bins - 1]
    regressor: HistGradientBoostingRegressor

    def predict(self, features: Array) -> Array:
        """Predictions for pixels with these features, [n]."""
        with one_openmp_thread():
            return np.asarray(self.regressor.predict(_bins(features, self.edges)))


def folds(action: Array, rows: Array, seed: int) -> Array:
    """The fold of each row's action, [B]; -1 for rows that are not among ``rows``."""
    _, number = np.unique(action[rows], return_inverse=True)
    drawn = np.random.default_rng([seed, 21]).permutation(number.max() + 1) % _FOLDS
    fold = np.full(len(action), -1)
    fold[rows] = drawn[number]
    return fold


class CrossFitted(NamedTuple):
    """Trees of each fold with their held-out predictions for n pixels."""

    trees: tuple[Trees, ...]
    predictions: Array
    """[n]; the mean of all folds for pixels without a fold."""
    share: float
    """Shrinkage factor, 0 to 1, that minimises the held-out error."""


def cross_fitted(features: Array, missing: Array, weight: Array, *, fold: Array, count: int) -> CrossFitted:
    """Fit ``count`` trees for each fold to the pixels of the other folds.

    Args:
        features: [n, F] of pixels.
        missing: target at each pixel, [n].
        weight: of each pixel's squared error, [n].
        fold: [n]; -1 for pixels that no trees are fitted to.
        count: of boosting rounds.
    """
    known = fold >= 0
    held_out = [~known | (fold == k) for k in range(_FOLDS)]  # pixels of this fold, and all without a fold

    def of_fold(k: int) -> tuple[Trees, Array]:
        part = grow(features, missing, weight, used=~held_out[k], count=count)
        return part, part.predict(features[held_out[k]])

    trees, parts = zip(*in_threads(of_fold, range(_FOLDS), get_num_threads()), strict=True)
    predictions = np.zeros(len(missing))
    for pixels, predicted in zip(held_out, parts, strict=True):
        predictions[pixels] += predicted
    predictions[~known] /= _FOLDS
    right = (weight * missing * predictions)[known].sum() / max((weight * predictions**2)[known].sum(), 1e-12)
    return CrossFitted(trees, predictions, float(np.clip(right, 0.0, 1.0)))


def grow(features: Array, missing: Array, weight: Array, *, used: Array, count: int) -> Trees:
    """Fit ``count`` trees to ``missing`` at the pixels ``used``, bool[n]; other arguments as for ``cross_fitted``."""
    seen = features[used]
    edges = np.quantile(seen, np.linspace(0, 1, _BINS + 1)[1:-1], axis=0).T
    trees = HistGradientBoostingRegressor(
        max_iter=count, learning_rate=_RATE, max_leaf_nodes=_LEAVES, min_samples_leaf=_PIXELS_A_LEAF,
        early_stopping=False, random_state=0,
    )  # fmt: skip
    with one_openmp_thread():
        return Trees(edges, trees.fit(_bins(seen, edges), missing[used], weight[used]))


def predict_held_out(trees: Sequence[Trees], features: Array, fold: Array) -> Array:
    """Held-out predictions of cross-fitted trees at other ``features`` [n, F] of the same pixels; 0 where ``fold`` is
    -1.
    """
    predictions = np.zeros(len(features))
    for k, part in enumerate(trees):
        held_out = fold == k
        predictions[held_out] = part.predict(features[held_out])
    return predictions


def cause_projection(statistics: Statistics, nuisances: int) -> Array:
    """Parameter changes [P] that come nearest to the predictions that ``statistics`` describe; causes within chance are
    0.

    Args:
        statistics: of the model with all causes, where the learned prediction takes the place of the residual.
        nuisances: number of parameters before the causes; these are always kept.
    """
    curvature, slope = statistics.curvature.sum(0), statistics.slope.sum(0)
    ridged = curvature + np.diag(_CAUSE_RIDGE * np.diag(curvature) + 1e-15)
    inverse = np.linalg.pinv(ridged, hermitian=True)
    amounts = inverse @ slope
    # Cluster-robust scores (White 1980): each action's deviation from the common fit.
    own = (statistics.slope - statistics.curvature @ amounts) @ inverse
    sure = np.abs(amounts) > _SURE_OF_CAUSE * np.sqrt(np.square(own).sum(0))
    sure[:nuisances] = True
    amounts = np.zeros_like(slope)
    amounts[sure] = np.linalg.lstsq(ridged[np.ix_(sure, sure)], slope[sure], rcond=None)[0]
    return amounts


def _bins(features: Array, edges: Array) -> Array:
    return np.stack([np.searchsorted(edge, column) for edge, column in zip(edges, features.T, strict=True)], axis=1)


def action_effect(values: Array, by: Array, weight: Array, row: Array) -> Array:
    """The random effect of each row in ``values`` [n] of pixels: the weighted least-squares fit by K regressors a row,
    [n].

    Position and width of a single action vary by chance. That variation hides what all actions share.

    Args:
        values: [n].
        by: derivative of each pixel by the K effects of its row, [n, K].
        weight: of each pixel's squared error, [n].
        row: row of each pixel, [n].
    """
    rows = int(row.max()) + 1

    def summed(columns: Array) -> Array:
        return np.stack([np.bincount(row, column, rows) for column in columns.T], axis=1)

    pairs = weight[:, None, None] * by[:, :, None] * by[:, None, :]
    curvature = summed(pairs.reshape(len(by), -1)).reshape(rows, by.shape[1], by.shape[1])
    slope = summed((weight * values)[:, None] * by)
    amounts = np.linalg.pinv(curvature, hermitian=True) @ slope[..., None]
    return np.asarray((by * amounts[row, :, 0]).sum(1))
