"""What a tool does to a material alike in every push and the analytic model does not foretell: a flank's curve, a rim's
slope, how a wall gives way.

Learnt by boosted trees as of strokes, pixel by pixel, from where a pixel lies about the way of the
tool, how deep and how far it goes, how high the surface stands, and how far it is to the ends of travel: nothing of
time, speed, dwell, room, heading or history. What of it looks like a cause is left in the residual. They learn twice,
as of strokes: where the arm came to be, and how deep, is chance. Sealed pushes are told in the end by trees that learn
from all others at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.boosting import Trees, action_effect, cause_projection, cross_fitted, folds, grow
from pentimento.diagnosis.pushes.jacobian import MM, linearise, residual
from pentimento.diagnosis.pushes.measured import MeasuredPushes
from pentimento.diagnosis.pushes.noise import by_scatter
from pentimento.dynamics.pushes.analytic import AnalyticPush, keep, settle, touch
from pentimento.dynamics.pushes.mechanisms import Mechanism
from pentimento.dynamics.pushes.mechanisms.mechanism import spread

Array = NDArray[Any]

_REACH = 3.0  # half-widths from the way of the tool: beyond, hardly anything moves
_TREES = 50
_FIRST_TREES = 20  # enough to see by how much each push is displaced
_SMALL = 1e-3
"""Of a number's typical size: a step that is small enough to be linear."""


@dataclass(frozen=True)
class LearnedPushResidual:
    """What was learnt, as seen from a model."""

    model: AnalyticPush
    trees: tuple[Trees, ...]
    share: float
    """By how much what the trees say is to be believed, 0 to 1."""
    cause_projection: Array
    """[P] of the model's numbers: what of it they would do."""

    def of(self, measured: MeasuredPushes) -> MeasuredPushes:
        """Pushes that nothing was learnt from, with their habits."""
        features, seen = _pixels(self.model, measured)
        return self._joined(measured, seen, np.mean([trees.predict(features) for trees in self.trees], axis=0))

    def learnt_from_all(self, measured: MeasuredPushes, rows: Array) -> tuple[LearnedPushResidual, MeasuredPushes]:
        """Habits learnt once more, from all pushes with the indices ``rows`` by one set of trees, which knows more than
        sets that each learn from a part; and the pushes, of which those that are none of ``rows`` have these.

        Args:
            measured: pushes that have these habits.
        """
        bare = replace(measured, habit=np.zeros_like(measured.habit))
        features, seen = _pixels(self.model, measured)
        push, weight = np.nonzero(seen)[0], measured.weight[seen]
        left, missing = (residual(self.model, pushes)[seen].astype(np.float64) for pushes in (measured, bare))
        missing -= action_effect(left, _scatter(self.model, measured, seen), weight, push)
        trees = grow(features, missing, weight, np.isin(push, rows), _TREES)
        learned_residual = replace(self, trees=(trees,))
        habit = learned_residual._joined(bare, seen, trees.predict(features)).habit
        habit[rows] = measured.habit[rows]
        return learned_residual, replace(measured, habit=habit)

    def _joined(self, measured: MeasuredPushes, seen: Array, said: Array) -> MeasuredPushes:
        scene = measured.scene
        moved = self.model.at(self.model.vector + _SMALL * self.cause_projection)
        alike = (moved.change(scene) - self.model.change(scene)) * np.float32(MM / _SMALL)
        return replace(measured, habit=self.share * _maps(said, seen) - alike)


def learn_residual(
    measured: MeasuredPushes, model: AnalyticPush, rows: Array, candidates: Sequence[Mechanism], seed: int
) -> tuple[LearnedPushResidual, MeasuredPushes]:
    """Habits of the pushes with the indices ``rows``, and all pushes with theirs instead of any that they had.

    Args:
        model: fitted to them.
        candidates: causes beside the model's whose effects must stay in the residual.
    """
    measured = replace(measured, habit=np.zeros_like(measured.habit))
    features, seen = _pixels(model, measured)
    push = np.nonzero(seen)[0]
    fold = folds(measured.action, rows, seed)[push]
    missing = residual(model, measured)[seen].astype(np.float64)
    weight = measured.weight[seen]
    _, said, share = cross_fitted(features, missing, weight, fold, _FIRST_TREES)
    # As of strokes, where the arm came to be is chance, and hides what is alike until some of that has been learnt.
    missing -= action_effect(missing - share * said, _scatter(model, measured, seen), weight, push)
    trees, said, share = cross_fitted(features, missing, weight, fold, _TREES)
    full = model.plus(*candidates)
    maps = share * _maps(said, seen)
    asked = replace(measured, after=measured.scene.before + full.change(measured.scene) + maps / np.float32(MM))
    amounts = cause_projection(linearise(full, asked.pick(rows)), full.nuisances)
    learned_residual = LearnedPushResidual(full, trees, share, amounts)
    return learned_residual, learned_residual._joined(measured, seen, said)


def _scatter(model: AnalyticPush, measured: MeasuredPushes, seen: Array) -> Array:
    """How each pixel [n] that is ``seen`` changes as the arm comes elsewhere, and deeper, [n, K]."""
    return np.asarray(by_scatter(model, measured.scene)[:, seen].T, dtype=np.float64)


def _maps(values: Array, seen: Array) -> Array:
    """Values [n] at their pixels, float32[B, H, W]."""
    maps = np.zeros(seen.shape, dtype=np.float32)
    maps[seen] = values
    return maps


def _pixels(model: AnalyticPush, measured: MeasuredPushes) -> tuple[Array, Array]:
    """Features [n, 13] of the pixels near the ways of the tool, and which these are, bool[B, H, W].

    How far ahead and aside of its place of the way a pixel lies, and how far; how deep the tool goes there and is to go
    in the end, and how far; how much of the surface is in its way, how high that is; what is heaped up there, and how
    much is pressed away around; what the model makes of it all; how far it is to both ends. What is told of places is
    in half-widths, what of commands and heights in millimetres.
    """
    scene = measured.scene
    half, (length, depth) = scene.half_width_m, (scene.action[:, k, None, None] for k in (3, 4))
    station = np.clip(scene.along, 0.0, length)
    ramp = np.where(length > 0, station / np.maximum(length, 1e-9), 1.0)
    ahead, aside = (scene.along - station) / half, np.abs(scene.across) / half
    away = np.hypot(ahead, aside)
    seen = measured.valid & (away < _REACH)
    contact = touch(model, scene)
    indentation = keep(model, scene, contact)
    told = (
        ahead, aside, away, depth * ramp * MM, *(np.broadcast_to(told * MM, away.shape) for told in (depth, length)),
        contact.pressed_m * MM, scene.before * MM, contact.heaped_m * MM,
        spread(indentation, half / scene.pixel_m) * MM, settle(model, scene, contact, indentation) * MM,
        np.minimum(station / half, _REACH), np.minimum((length - station) / half, _REACH),
    )  # fmt: skip
    return np.stack([maps[seen] for maps in told], axis=1).astype(np.float64), seen
