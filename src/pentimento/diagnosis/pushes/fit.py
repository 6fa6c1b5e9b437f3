"""Least squares on pushes: Gauss-Newton with Levenberg's damping on the sum over actions, and weights of pushes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.gauss_newton import damped_step, predicted_decrease
from pentimento.diagnosis.pushes.jacobian import Slopes, action_losses, mean_squared_error, residual, slopes_of
from pentimento.diagnosis.pushes.measured import MeasuredPushes
from pentimento.dynamics.pushes.analytic import BASE, KNOTS, PROFILE, AnalyticPush, first_model
from pentimento.dynamics.pushes.analytic_scene import distance_from_path

Array = NDArray[Any]

_HOLD = 0.001
"""Of the error: what a number costs that lies as far from its start as is likely."""
_LIKELY = {
    "log_radius": 1.0,
    "log_gain": 0.3,
    "log_gain_by_depth": 0.2,
    "log_edge": 1.0,
    "log_aspect": 0.3,
    "corners": 0.3,
    "give_mm": 1.0,
    "kept": 0.3,
    "log_rims": 0.5,
    "facing": 0.5,
    "stand_off": 1.0,
    "along_mm": 1.0,
    "end_lift": 2.0,
    "end_pull": 1.0,
    "log_blur": 0.7,
}
_RANGE = {
    "log_radius": (-2.0, 3.0),
    "log_gain": (-1.5, 1.5),
    "log_gain_by_depth": (-1.0, 1.0),
    "log_edge": (-2.0, 1.5),
    "log_aspect": (-1.5, 1.5),
    "corners": (-0.5, 0.6),
    "give_mm": (0.0, 6.0),
    "kept": (0.05, 1.5),
    "log_rims": (-1.5, 0.7),
    "facing": (-1.0, 1.5),
    "stand_off": (0.0, 3.5),
    "along_mm": (-3.0, 3.0),
    "end_lift": (-6.0, 15.0),
    "end_pull": (-6.0, 6.0),
    "log_blur": (float(np.log(0.3)), float(np.log(4.0))),
}
_PROFILE_LIKELY_MM = 4.0
_PROFILE_RANGE_MM = (-5.0, 60.0)
_ENOUGH = 5e-4
"""Relative fall of the error below which a fit has ended."""
_ENOUGH_ON_THE_WAY = _ENOUGH / 10
"""The same while a number goes as far as it may in one iteration: a slide that is slight may show late."""
_FIRST_DAMPING, _NEXT_DAMPING, _MIN_DAMPING = 1e-4, 1e-3, 1e-7
"""Of a number's own curvature: at first, once a step has failed, and where all goes well."""
_BENDS = 0.1
"""Of what a step promised: less of it gained shows that the valley bends."""
_AS_PROMISED = 0.7
"""Of what a step promised: where so much is gained, the slopes at its start serve for the next one as well."""
_LONGEST = 0.5
"""How far a number may go in one iteration; a mechanism's may go by twice of it in typical sizes."""
_MAX_UNEQUAL = 8.0
_RINGS = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0)
"""Half-widths from the tool's way between which pixels are weighted alike."""
_MAX_UNEVEN = 30.0


def fit(
    model: AnalyticPush, measured: MeasuredPushes, slopes: Slopes | None = None, iterations: int = 30
) -> AnalyticPush:
    """The model whose foretold heights are nearest to the measured, by weighted mean squared error.

    What the pushes leave open is held near the plainest base: a ball, rims all round, a hard edge.

    Args:
        slopes: the model's on these pushes, where they are known.
    """
    start = _start(measured)
    slopes = slopes or slopes_of(model, measured)
    statistics = slopes.statistics(model)
    loss = float(statistics.energy.mean())
    hold = _hold(model, loss)
    loss += _cost(_away(model, start), hold)
    damping = _FIRST_DAMPING
    low, high = _bounds(model)
    reach = np.concatenate([np.full(len(BASE), _LONGEST), np.full(len(model.vector) - len(BASE), 2 * _LONGEST)])
    reach[[BASE.index(name) for name in PROFILE]] = 2.0
    for _ in range(iterations):
        near = np.maximum(low, model.vector - reach), np.minimum(high, model.vector + reach)
        improved = False
        for _ in range(6):
            moved = damped_step(model.vector, _away(model, start), statistics, damping, hold, *near)
            candidate = model.at(moved)
            new = _loss(candidate, measured) + _cost(_away(candidate, start), hold)
            if new < loss:
                improved = True
                break
            damping = max(damping * 10, _NEXT_DAMPING)
        if not improved:
            break
        gained = loss - new
        promise = predicted_decrease(moved - model.vector, _away(model, start), statistics, hold)
        at_reach = ((moved == near[0]) & (moved > low)) | ((moved == near[1]) & (moved < high))
        if at_reach.any():
            ended = gained < _ENOUGH_ON_THE_WAY * new
        else:
            # What a whole step gives less, or more, than it promised is about what the next one can still give.
            left = abs(promise - gained) if damping <= _FIRST_DAMPING else gained
            ended = min(gained, left) < _ENOUGH * new
        # A valley that bends gives little of what it promised: it is followed in shorter steps.
        bends = gained < _BENDS * promise and promise > _ENOUGH * new
        ended &= not bends
        model, loss = candidate, new
        damping = damping * 10 if bends else max(damping / 10, _MIN_DAMPING)
        if ended:
            break
        if gained < _AS_PROMISED * promise:
            slopes = slopes_of(model, measured)
        statistics = slopes.statistics(model)
    return model


def fit_without(model: AnalyticPush, cause: str, base: AnalyticPush, measured: MeasuredPushes) -> AnalyticPush:
    """The model without one cause, fitted from its own numbers or from those of the base alone, whichever foretell
    better: a base that a large cause has bent takes long to come back.

    Args:
        base: the same without any cause, fitted.
    """
    rest = model.without(cause)
    starts = rest, replace(rest, base=base.base)
    return fit(min(starts, key=lambda start: _loss(start, measured)), measured)


def equalised(measured: MeasuredPushes, model: AnalyticPush) -> MeasuredPushes:
    """The pushes with weights: the inverse of each one's error about the model, and of the error that all have as far
    from the tool's way, within bounds, 1 on average.

    A deep push that meets an old groove is wrong by tens of times what a shallow one is: unweighted, few such pushes
    would say all. And what a base gets wrong under the tool would drown what rises far from it.
    """
    missed, seen = residual(model, measured), measured.valid
    ring, rings = np.digitize(distance_from_path(measured.scene), _RINGS), len(_RINGS) + 1
    squared = (_levelled(missed, measured) * np.square(missed))[seen]
    of_ring = np.bincount(ring[seen], squared, rings) / np.maximum(np.bincount(ring[seen], minlength=rings), 1)
    place = 1 / np.maximum(of_ring, of_ring.max() / _MAX_UNEVEN)[ring]
    weight = (_levelled(np.sqrt(place) * missed, measured) * place).astype(np.float32)
    return replace(measured, weight=weight / weight[seen].mean())


def _levelled(missed: Array, measured: MeasuredPushes) -> Array:
    """Weights [B, 1, 1] of pushes that miss so much, [B, H, W]."""
    error = mean_squared_error(missed, measured)
    return np.clip(np.median(error) / np.maximum(error, 1e-12), 1 / _MAX_UNEQUAL, _MAX_UNEQUAL)[:, None, None]


def _start(measured: MeasuredPushes) -> Array:
    return first_model(measured.scene).base


def _hold(model: AnalyticPush, loss: float) -> Array:
    """Curvature [P, P] of what holds the base where pushes leave it open."""
    hold = np.zeros((len(model.vector), len(model.vector)))
    for i, name in enumerate(BASE):
        likely = _PROFILE_LIKELY_MM * KNOTS[PROFILE.index(name)] if name in PROFILE else _LIKELY[name]
        hold[i, i] = 1 / likely**2
    return _HOLD * loss * hold


def _away(model: AnalyticPush, start: Array) -> Array:
    """How far each number is from its start."""
    away = model.vector.copy()
    away[: len(start)] -= start
    return away


def _cost(away: Array, hold: Array) -> float:
    return float(away @ hold @ away)


def _bounds(model: AnalyticPush) -> tuple[Array, Array]:
    """Where the model's numbers mean something."""
    low, high = np.full(len(model.vector), -np.inf), np.full(len(model.vector), np.inf)
    for i, name in enumerate(BASE):
        low[i], high[i] = _PROFILE_RANGE_MM if name in PROFILE else _RANGE[name]
    # What cannot be below zero ends there: where it is nothing, chance would take it below in every second table.
    quantities = [quantity for mechanism in model.mechanisms for quantity in mechanism.quantities]
    low[len(BASE) :][[not quantity.signed for quantity in quantities]] = 0.0
    return low, high


def _loss(model: AnalyticPush, measured: MeasuredPushes) -> float:
    return float(action_losses(model, measured).mean())
