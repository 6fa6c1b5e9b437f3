"""Learned residual model of strokes: what a tool does in every stroke beyond a small base (docs/diagnosis.md §4).

Boosted trees predict coverage errors pixel by pixel (tufts, ragged ends, a paler side). Their inputs are the pixel's
position relative to its place on the path, coverage, press and its slope, distance to the ends, and how a turned tool
lies to its heading. No covariate of a cause is an input. Predictions for a stroke come from other strokes
(cross-fitting), and the part that resembles a cause is projected out, so that no cause's score changes.

The trees are fitted twice. The first fit serves to estimate each stroke's own displacement and width, which are removed
from the target of the second. If the first trees find the tool symmetric, the second see mirrored pixels as one side.
Other strokes get the mean prediction of all folds' trees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.diagnosis.boosting import (
    Trees,
    action_effect,
    cause_projection,
    cross_fitted,
    folds,
    predict_held_out,
)
from pentimento.diagnosis.strokes.fit import stiffened
from pentimento.diagnosis.strokes.jacobian import change_of_photographs, linearise, slope_by_coverage
from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.model import Model
from pentimento.diagnosis.strokes.predict import ink_of, mark_px, predicted, press_shares, residual
from pentimento.diagnosis.strokes.soft_edge import Footprint
from pentimento.dynamics.strokes.correction import is_turned
from pentimento.dynamics.strokes.simulation import Mechanism

Array = NDArray[Any]

_FAINTEST = 0.03
"""Squared slope of sRGB by coverage below which coverage is not visible."""
_FARTHEST = 3.0
"""Half-widths from an end beyond which a stroke's body is uniform."""
_STEADIED = 0.001
"""Share of the fit's prior in the projection on causes: too small to shrink it, enough where nothing was seen."""
_TREES = 50
"""Boosting rounds."""
_FIRST_TREES = 20
"""Boosting rounds of the first fit; enough to estimate each stroke's displacement."""
_LEFT = 0
"""Index of the feature "left of the path", which changes its sign under reflection."""
_SINE = 8
"""Index of the sine of the tool's lie, likewise."""


@dataclass(frozen=True)
class LearnedResidual:
    """A fitted learned residual model, relative to a stroke model."""

    model: Model
    trees: tuple[Trees, ...]
    share: float
    """Shrinkage factor of the trees' predictions, 0 to 1."""
    cause_projection: Array
    """[P] parameter changes of the model that the predictions resemble."""
    turned: bool
    """Whether the tool's lie is an input."""
    mirrored: bool
    """Whether left and right are treated as one side."""

    def seen_from(self, model: Model) -> LearnedResidual:
        """The same relative to a model with more paints; the projection is 0 for these."""
        new = model.nuisances - self.model.nuisances
        return replace(
            self, model=model, cause_projection=np.insert(self.cause_projection, [self.model.nuisances] * new, 0.0)
        )

    def of(self, measured: Measured) -> Measured:
        """The strokes with predictions; none of them may have been used for the fit."""
        pixels = _Pixels(self.model, measured, self.turned)
        return self._joined(measured, pixels, self._predict(pixels))

    def _inputs_of(self, pixels: _Pixels) -> Array:
        return one_sided(pixels.features) if self.mirrored else pixels.features

    def _predict(self, pixels: _Pixels) -> Array:
        features = self._inputs_of(pixels)
        return np.asarray(np.mean([trees.predict(features) for trees in self.trees], axis=0))

    def _joined(self, measured: Measured, pixels: _Pixels, predictions: Array) -> Measured:
        residual_prediction = self.share * pixels.photographs(predictions)
        return replace(
            measured,
            residual_prediction=residual_prediction
            - change_of_photographs(self.model, measured, self.cause_projection),
        )


def learn_residual(
    measured: Measured, model: Model, rows: Array, *, candidates: Sequence[Mechanism], seed: int
) -> tuple[LearnedResidual, Measured]:
    """Fit to the strokes with the indices ``rows``, and return all strokes with predictions that replace any earlier
    ones.

    Args:
        measured: all strokes.
        model: fitted to the strokes ``rows``.
        rows: indices.
        candidates: causes beside the model's whose effects must stay in the residual.
        seed: of the folds.
    """
    measured = replace(measured, residual_prediction=np.zeros_like(measured.residual_prediction))
    # For a tool that is never turned, the lie is the heading on the canvas, which causes depend on.
    turned = is_turned(measured.samples.path[rows])
    pixels = _Pixels(model, measured, turned)
    missing = pixels.along_slope(residual(model, measured))
    features, fold = pixels.features, folds(measured.action, rows, seed)[pixels.stroke]
    trees, predictions, share = cross_fitted(features, missing, pixels.depth, fold=fold, count=_FIRST_TREES)
    both = (predictions + predict_held_out(trees, mirrored_features(features), fold)) / 2
    learnt = fold >= 0
    mirrored = bool((pixels.depth * (np.square(missing - both) - np.square(missing - predictions)))[learnt].sum() < 0)
    # Each stroke's own displacement and width are chance. They are estimated once the common part is subtracted.
    missing -= action_effect(missing - share * predictions, pixels.by_place_and_width, pixels.depth, pixels.stroke)
    features = one_sided(features) if mirrored else features
    trees, predictions, share = cross_fitted(features, missing, pixels.depth, fold=fold, count=_TREES)
    full = model.plus(*candidates)
    amounts = _fitted(share * pixels.photographs(predictions), measured, full, rows)
    unlike = [m.cause for m in candidates if not amounts[full.columns_of(m.cause)].any()]
    columns = [full.columns_of(cause) for cause in unlike]
    amounts = np.delete(amounts, np.concatenate(columns) if columns else [])
    learned_residual = LearnedResidual(full.without(*unlike), trees, share, amounts, turned, mirrored)
    return learned_residual, learned_residual._joined(measured, pixels, predictions)


class _Pixels:
    """Pixels of strokes where coverage is visible."""

    def __init__(self, model: Model, measured: Measured, turned: bool) -> None:
        mark = mark_px(model, measured)
        laid = ink_of(mark, model, measured)
        self._towards = slope_by_coverage(laid, measured)
        depth = np.square(self._towards).sum(-1)
        self._seen = (laid.footprint.segment >= 0) & (depth > _FAINTEST)
        self.depth = depth[self._seen]
        """How clearly coverage shows, [n]."""
        self.stroke = np.nonzero(self._seen)[0]
        """Index of each one's stroke, [n]."""
        self.by_place_and_width = laid.footprint.by_mark[self._seen][:, :3].astype(float)
        """How coverage changes as the mark there moves, two ways, and widens, [n, 3]."""
        lie = _lie(mark, measured.samples.path[..., 4].double().numpy()) if turned else []
        self.features = _features(laid.footprint, self._seen, mark, press_shares(model, measured), lie)

    def along_slope(self, photographs: Array) -> Array:
        """The coverage [n] that photographs [B, H, W, 3] amount to."""
        return np.asarray((photographs * self._towards).sum(-1)[self._seen] / self.depth)

    def photographs(self, coverage: Array) -> Array:
        """What coverage [n] does to the photographs, float32[B, H, W, 3]."""
        change = np.zeros_like(self._towards)
        change[self._seen] = coverage[:, None] * self._towards[self._seen]
        return change


def mirrored_features(features: Array) -> Array:
    """The features of the mirrored pixel on the other side of the path."""
    mirrored = features.copy()
    mirrored[:, [_LEFT, *range(_SINE, features.shape[1])]] *= -1
    return mirrored


def one_sided(features: Array) -> Array:
    """The features with all pixels reflected to the left side."""
    return np.where(features[:, [_LEFT]] < 0, mirrored_features(features), features)


def _lie(mark: Array, yaw: Array) -> list[Array]:
    """How the tool lies to its heading, [B, N] each: cosine and sine of twice the angle, because half a turn is no
    change.
    """
    step = np.gradient(mark[..., :2], axis=1)
    twice = 2 * (np.arctan2(-step[..., 1], step[..., 0]) - yaw)
    return [np.cos(twice), np.sin(twice)]


def _features(footprint: Footprint, seen: Array, mark: Array, press: Array, lie: Sequence[Array]) -> Array:
    """[n, 7 + len(lie)]: position left and ahead of the place on the path; coverage; press and its slope; distances to
    start and end; the tool's lie. Lengths in half-widths.
    """
    stroke, k, t = np.nonzero(seen)[0], footprint.segment[seen].astype(int), footprint.along[seen]
    half = np.maximum(mark[..., 2], 1e-3)
    step = np.linalg.norm(np.diff(mark[..., :2], axis=1), axis=-1)
    arc = np.concatenate([np.zeros((len(step), 1)), np.cumsum(step, axis=1)], axis=1)
    slope = np.gradient(press, axis=1) / np.maximum(np.gradient(arc, axis=1), 1e-6) * half
    following = np.minimum(k + 1, arc.shape[1] - 1)

    def there(values: Array) -> Array:
        return np.asarray(values[stroke, k] * (1 - t) + values[stroke, following] * t)

    here, width = there(arc), there(half)
    ends = [np.minimum(far / width, _FARTHEST) for far in (here, arc[stroke, -1] - here)]
    turns = [there(values) for values in lie]
    return np.stack(
        [*footprint.place[seen].T, footprint.coverage[seen], there(press), there(slope), *ends, *turns], axis=1
    )


def _fitted(photographs: Array, measured: Measured, model: Model, rows: Array) -> Array:
    """Parameter changes [P] of the model whose effect on the strokes ``rows`` comes nearest to ``photographs`` [B, H,
    W, 3].
    """
    after = torch.from_numpy((predicted(model, measured) + photographs).astype(np.float32))
    asked = replace(measured, samples=measured.samples._replace(after=after)).pick(rows)
    # A weak prior: directions without information would extrapolate to absurd values on other strokes.
    return cause_projection(stiffened(linearise(model, asked), model, _STEADIED), model.nuisances)
