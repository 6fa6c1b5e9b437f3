"""Learned residual model: systematic errors of the analytic push model, such as a flank's curve or a rim's slope.

Boosted trees predict the residual pixel by pixel, cross-fitted by action as for strokes. Their features are the pixel's
place relative to the tool's path, the command, and the surface; time, speed, dwell, place on the table, heading and
history are excluded. The part of the prediction that looks like a cause is left in the residual. The trees are fitted
twice, because execution noise hides the systematic part at first. Other pushes get the mean
prediction of all folds' trees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.boosting import Trees, action_effect, cause_projection, cross_fitted, folds
from pentimento.diagnosis.pushes.floor import noise_derivatives
from pentimento.diagnosis.pushes.jacobian import MM, linearise, residual
from pentimento.diagnosis.pushes.measured import MeasuredPushes
from pentimento.planning.pushes.analytic.mechanisms import Mechanism
from pentimento.planning.pushes.analytic.mechanisms.mechanism import spread
from pentimento.planning.pushes.analytic.model import AnalyticPush, keep, settle, touch

Array = NDArray[Any]

_REACH = 3.0
"""Distance from the tool's path in half-widths beyond which the residual is not modelled."""
_TREES = 50
"""Boosting rounds."""
_FIRST_TREES = 20
"""Boosting rounds of the first fit, from which each push's execution noise is estimated."""
_MAX_NUISANCE = 0.5
"""Maximum change of a nuisance parameter that is taken from the prediction; one step of a fit is as long."""
_LINEAR_STEP = 1e-3
"""Finite-difference step, relative to a parameter's typical size."""


@dataclass(frozen=True)
class LearnedPushResidual:
    """A fitted residual model, relative to an analytic model."""

    model: AnalyticPush
    trees: tuple[Trees, ...]
    share: float
    """Shrinkage of the trees' prediction, 0 to 1."""
    cause_projection: Array
    """[P]: parameters of the model whose effect is aliased with the prediction, and removed from it."""

    def of(self, measured: MeasuredPushes) -> MeasuredPushes:
        """New pushes with their learned residual."""
        features, seen = _pixels(self.model, measured)
        return self._with_prediction(measured, seen, np.mean([trees.predict(features) for trees in self.trees], axis=0))

    def _with_prediction(self, measured: MeasuredPushes, seen: Array, predicted: Array) -> MeasuredPushes:
        scene = measured.scene
        moved = self.model.at(self.model.vector + _LINEAR_STEP * self.cause_projection)
        aliased = (moved.change(scene) - self.model.change(scene)) * np.float32(MM / _LINEAR_STEP)
        return replace(measured, learned_mm=self.share * _maps(predicted, seen) - aliased)


def learn_residual(
    measured: MeasuredPushes, model: AnalyticPush, rows: Array, *, candidates: Sequence[Mechanism], seed: int
) -> tuple[LearnedPushResidual, MeasuredPushes]:
    """Cross-fit the residual model to the pushes ``rows``; all pushes get its prediction in place of an earlier one.

    Args:
        model: fitted to them.
        candidates: causes beside the model's whose effects must stay in the residual.
    """
    measured = replace(measured, learned_mm=np.zeros_like(measured.learned_mm))
    features, seen = _pixels(model, measured)
    push = np.nonzero(seen)[0]
    fold = folds(measured.action, rows, seed)[push]
    target = residual(model, measured)[seen].astype(np.float64)
    weight = measured.weight[seen]
    _, predicted, share = cross_fitted(features, target, weight, fold=fold, count=_FIRST_TREES)
    # Execution noise hides the systematic residual, so it is removed once part of the residual has been learned.
    target -= action_effect(target - share * predicted, _noise_at(model, measured, seen), weight, push)
    trees, predicted, share = cross_fitted(features, target, weight, fold=fold, count=_TREES)
    full = model.plus(*candidates)
    maps = share * _maps(predicted, seen)
    predicted_only = replace(
        measured, after=measured.scene.before + full.change(measured.scene) + maps / np.float32(MM)
    )
    statistics = linearise(full, predicted_only.pick(rows))
    amounts = cause_projection(statistics, full.nuisances)
    # The pushes hardly determine some nuisances; their linear effect must not be extrapolated.
    held = (np.abs(amounts) > _MAX_NUISANCE) & (np.arange(len(amounts)) < full.nuisances)
    amounts[held] = np.clip(amounts[held], -_MAX_NUISANCE, _MAX_NUISANCE)
    curvature, slope = statistics.curvature.sum(0), statistics.slope.sum(0)
    free = ~held & (amounts != 0)
    amounts[free] = np.linalg.lstsq(curvature[np.ix_(free, free)], slope[free] - curvature[free] @ (amounts * held))[0]
    learned_residual = LearnedPushResidual(full, trees, share, amounts)
    return learned_residual, learned_residual._with_prediction(measured, seen, predicted)


def _noise_at(model: AnalyticPush, measured: MeasuredPushes, seen: Array) -> Array:
    """Sensitivity of each pixel [n] that is ``seen`` to execution noise, [n, K]."""
    return np.asarray(noise_derivatives(model, measured.scene)[:, seen].T, dtype=np.float64)


def _maps(values: Array, seen: Array) -> Array:
    """Values [n] at their pixels, float32[B, H, W]."""
    maps = np.zeros(seen.shape, dtype=np.float32)
    maps[seen] = values
    return maps


def _pixels(model: AnalyticPush, measured: MeasuredPushes) -> tuple[Array, Array]:
    """Features [n, 13] of the pixels near the tool's path, and the mask of these pixels, bool[B, H, W].

    Distance ahead of and beside the nearest station, and total; tip depth there, commanded depth and length; pressed
    depth, surface height, heaped height; indentation nearby; predicted change; distances to both ends. Places are in
    half-widths of the footprint, commands and heights in millimetres.
    """
    scene = measured.scene
    half, (length, depth) = scene.half_width_m, (scene.action[:, k, None, None] for k in (3, 4))
    station = np.clip(scene.along, 0.0, length)
    ramp = np.where(length > 0, station / np.maximum(length, 1e-9), 1.0)
    ahead, aside = (scene.along - station) / half, np.abs(scene.across) / half
    distance = np.hypot(ahead, aside)
    seen = measured.valid & (distance < _REACH)
    contact = touch(model, scene)
    indentation = keep(model, scene, contact)
    features = (
        ahead, aside, distance, depth * ramp * MM,
        *(np.broadcast_to(command * MM, distance.shape) for command in (depth, length)),
        contact.pressed_m * MM, scene.before * MM, contact.heaped_m * MM,
        spread(indentation, half / scene.pixel_m) * MM, settle(model, scene, contact, indentation) * MM,
        np.minimum(station / half, _REACH), np.minimum((length - station) / half, _REACH),
    )  # fmt: skip
    return np.stack([maps[seen] for maps in features], axis=1).astype(np.float64), seen
