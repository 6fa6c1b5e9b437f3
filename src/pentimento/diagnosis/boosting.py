"""Boosted trees that learn what no base of a few numbers foretells, each said of actions that it has not seen
(cross-fitting; Chernozhukov et al. 2018), and what of it looks like a cause.
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
_LEAVES, _PIXELS_A_LEAF, _RATE, _BINS = 64, 30, 0.18, 255
_CAUSE_RIDGE = 1e-4
_SURE_OF_CAUSE = 3.5
"""Standard errors. What goes with something that no tree is told (speed, time, the sheet) is no habit. Where habits
look like it by a chance of the design, that must go with them: with all else gone, it would stand out.
"""


class Trees(NamedTuple):
    """Trees on features [n, F] as numbers of bins: left to bin them by itself, a regressor with weights takes four
    times as long for that as for growing.
    """

    edges: Array  # [F, bins - 1]
    grown: HistGradientBoostingRegressor

    def say(self, features: Array) -> Array:
        """What they foretell of each pixel [n]."""
        with one_openmp_thread():
            return np.asarray(self.grown.predict(_bins(features, self.edges)))


def folds(action: Array, rows: Array, seed: int) -> Array:
    """Of each row the fold that its action is in, [B]; -1 where it is none of ``rows``."""
    _, number = np.unique(action[rows], return_inverse=True)
    drawn = np.random.default_rng([seed, 21]).permutation(number.max() + 1) % _FOLDS
    fold = np.full(len(action), -1)
    fold[rows] = drawn[number]
    return fold


def cross_fitted(
    features: Array, missing: Array, weight: Array, fold: Array, count: int
) -> tuple[tuple[Trees, ...], Array, float]:
    """``count`` trees for each ``fold`` [n], which are not grown on its pixels; what they say is ``missing`` where they
    were not grown, [n]; and what share of this is to be believed, 0 to 1.

    Args:
        features: [n, F] of pixels.
        weight: [n] of each one's squared error.
        fold: [n], -1 for pixels that none is grown on.
    """
    known = fold >= 0

    def of_fold(k: int) -> tuple[Trees, Array, Array]:
        part = grown(features, missing, weight, known & (fold != k), count)
        told = ~known | (fold == k)  # an action that was learnt from, by those that did not see it
        return part, told, part.say(features[told])

    trees, *parts = zip(*in_threads(of_fold, range(_FOLDS), get_num_threads()), strict=True)
    said = np.zeros(len(missing))
    for told, what in zip(*parts, strict=True):
        said[told] += what
    said[~known] /= _FOLDS
    right = (weight * missing * said)[known].sum() / max((weight * said**2)[known].sum(), 1e-12)
    return trees, said, float(np.clip(right, 0.0, 1.0))


def grown(features: Array, missing: Array, weight: Array, used: Array, count: int) -> Trees:
    """``count`` trees that learn what is ``missing`` at the pixels ``used``, bool[n]; the rest as ``cross_fitted``."""
    seen = features[used]
    edges = np.quantile(seen, np.linspace(0, 1, _BINS + 1)[1:-1], axis=0).T
    trees = HistGradientBoostingRegressor(
        max_iter=count, learning_rate=_RATE, max_leaf_nodes=_LEAVES, min_samples_leaf=_PIXELS_A_LEAF,
        early_stopping=False, random_state=0,
    )  # fmt: skip
    with one_openmp_thread():
        return Trees(edges, trees.fit(_bins(seen, edges), missing[used], weight[used]))


def said_at(trees: Sequence[Trees], features: Array, fold: Array) -> Array:
    """What cross-fitted trees say at other ``features`` [n, F] of the pixels, each of those that they were not grown
    on; 0 of a pixel that none was grown on, [n].
    """
    said = np.zeros(len(features))
    for k, part in enumerate(trees):
        told = fold == k
        said[told] = part.say(features[told])
    return said


def like_causes(statistics: Statistics, nuisances: int) -> Array:
    """Changes [P] of a model's numbers that come nearest to what was said of the actions in ``statistics``; 0 of those
    beyond the first ``nuisances`` that come to no more than chance.
    """
    curvature, slope = statistics.curvature.sum(0), statistics.slope.sum(0)
    ridged = curvature + np.diag(_CAUSE_RIDGE * np.diag(curvature) + 1e-15)
    inverse = np.linalg.pinv(ridged, hermitian=True)
    amounts = inverse @ slope
    # An action is one witness (White 1980): what it asks for beyond what all do.
    own = (statistics.slope - statistics.curvature @ amounts) @ inverse
    sure = np.abs(amounts) > _SURE_OF_CAUSE * np.sqrt(np.square(own).sum(0))
    sure[:nuisances] = True
    amounts = np.zeros_like(slope)
    amounts[sure] = np.linalg.lstsq(ridged[np.ix_(sure, sure)], slope[sure], rcond=None)[0]
    return amounts


def _bins(features: Array, edges: Array) -> Array:
    return np.stack([np.searchsorted(edge, column) for edge, column in zip(edges, features.T, strict=True)], axis=1)


def action_effect(values: Array, by: Array, weight: Array, row: Array) -> Array:
    """Of ``values`` of pixels what combinations of ``by``, another for each row, come nearest to, [n].

    Args:
        values: [n].
        by: [n, K]: how each pixel changes with K numbers of its row.
        weight: [n] of each pixel's squared error.
        row: [n], which row it is of.
    """
    rows = int(row.max()) + 1

    def summed(columns: Array) -> Array:
        return np.stack([np.bincount(row, column, rows) for column in columns.T], axis=1)

    pairs = weight[:, None, None] * by[:, :, None] * by[:, None, :]
    curvature = summed(pairs.reshape(len(by), -1)).reshape(rows, by.shape[1], by.shape[1])
    slope = summed((weight * values)[:, None] * by)
    amounts = np.linalg.pinv(curvature, hermitian=True) @ slope[..., None]
    return np.asarray((by * amounts[row, :, 0]).sum(1))
