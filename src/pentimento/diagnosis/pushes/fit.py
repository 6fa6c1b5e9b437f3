"""Least squares on pushes: Gauss-Newton with Levenberg's damping and a Gaussian prior, and weights."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.gauss_newton import damped_step, predicted_decrease
from pentimento.diagnosis.pushes.jacobian import KeptColumns, action_losses, mean_squared_error, residual, slopes_of
from pentimento.diagnosis.pushes.measured import MeasuredPushes
from pentimento.planning.pushes.analytic.model import (
    BASE,
    KNOTS,
    PROFILE,
    AnalyticPush,
    first_model,
)
from pentimento.planning.pushes.analytic.scene import distance_from_path

Array = NDArray[Any]
_PRIOR_WEIGHT = 0.001
"""Cost of a parameter at one prior width from its start, relative to the error."""
_PRIORS = {
    "log_radius": (1.0, -2.0, 3.0),
    "log_gain": (0.3, -1.5, 1.5),
    "log_gain_by_depth": (0.2, -1.0, 1.0),
    "log_edge": (1.0, -2.0, 1.5),
    "log_aspect": (0.3, -1.5, 1.5),
    "corners": (0.3, -0.5, 0.6),
    "give_mm": (1.0, 0.0, 6.0),
    "kept": (0.3, 0.05, 1.5),
    "log_rims": (0.5, -1.5, 0.7),
    "facing": (0.5, -1.0, 1.5),
    "flanking": (0.5, -1.0, 1.0),
    "log_steep": (1.0, -3.0, 1.5),
    "stand_off": (1.0, 0.0, 3.5),
    "refill": (0.3, 0.0, 1.0),
    "along_mm": (1.0, -3.0, 3.0),
    "end_lift": (2.0, -6.0, 15.0),
    "end_pull": (1.0, -6.0, 6.0),
    "smear": (0.5, 0.0, 1.5),
    "log_blur": (0.7, float(np.log(0.3)), float(np.log(4.0))),
}
"""Prior standard deviation, lower and upper bound of the base's parameters."""
_PROFILE_PRIOR_WIDTH_MM = 4.0
"""Prior standard deviation of a profile offset at one half-width of the footprint; it is proportional to the radius."""
_PROFILE_RANGE_MM = (-5.0, 60.0)
"""Bounds of the profile offsets."""
_TOLERANCE = 5e-4
"""Relative fall of the error below which a fit has converged."""
_TOLERANCE_AT_REACH = _TOLERANCE / 10
"""The same while a parameter moves by its maximum step: a slight slide may show late."""
_FIRST_DAMPING = 1e-4
"""Damping at the start, relative to a parameter's own curvature."""
_NEXT_DAMPING = 1e-3
"""Damping after a failed step, at least."""
_MIN_DAMPING = 1e-7
"""Damping after successful steps, at least."""
_CURVED = 0.1
"""Fraction of the predicted fall below which the valley counts as curved."""
_NEARLY_LINEAR = 0.7
"""Fraction of the predicted fall above which the Jacobian is reused for the next step."""
_MAX_STEP = 0.5
"""Maximum step of a parameter in one iteration; a mechanism's quantity may move twice as far, in typical sizes."""
_MAX_WEIGHT_RATIO = 8.0
"""Maximum factor between a push's weight and 1."""
_RINGS = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0)
"""Distances from the tool's path, in half-widths, between which pixels are weighted equally."""
_MAX_RING_RATIO = 30.0
"""Maximum ratio between the weights of two rings."""


def fit(
    model: AnalyticPush, measured: MeasuredPushes, iterations: int = 30, kept: KeptColumns | None = None
) -> AnalyticPush:
    """The model that minimises the weighted mean squared error of predicted heights.

    Parameters that the pushes do not determine stay near the simplest base: a ball, equal rims all round, a hard edge.

    Args:
        model: to start from.
        measured: the pushes.
        iterations: at most.
        kept: of the same pushes; lends and keeps columns at the start.
    """
    start = _start(measured)
    slopes = slopes_of(model, measured) if kept is None else kept.slopes_of(model)
    statistics = slopes.statistics(model)
    loss = float(statistics.energy.mean())
    prior = _prior(model, loss)
    loss += _cost(_offset(model, start), prior)
    damping = _FIRST_DAMPING
    low, high = _bounds(model)
    reach = np.concatenate([np.full(len(BASE), _MAX_STEP), np.full(len(model.vector) - len(BASE), 2 * _MAX_STEP)])
    reach[[BASE.index(name) for name in PROFILE]] = 2.0
    for _ in range(iterations):
        near = np.maximum(low, model.vector - reach), np.minimum(high, model.vector + reach)
        improved = False
        for _ in range(6):
            moved = damped_step(
                model.vector, _offset(model, start), statistics, damping=damping, hold=prior, bounds=near
            )
            candidate = model.at(moved)
            new = _loss(candidate, measured) + _cost(_offset(candidate, start), prior)
            if new < loss:
                improved = True
                break
            damping = max(damping * 10, _NEXT_DAMPING)
        if not improved:
            break
        gained = loss - new
        predicted_fall = predicted_decrease(moved - model.vector, _offset(model, start), statistics, prior)
        at_reach = ((moved == near[0]) & (moved > low)) | ((moved == near[1]) & (moved < high))
        if at_reach.any():
            ended = gained < _TOLERANCE_AT_REACH * new
        else:
            # The difference between actual and predicted fall of a full step estimates the fall of the next one.
            left = abs(predicted_fall - gained) if damping <= _FIRST_DAMPING else gained
            ended = min(gained, left) < _TOLERANCE * new
        # In a curved valley a step gains little of its predicted fall; it is followed in shorter steps.
        curved = gained < _CURVED * predicted_fall and predicted_fall > _TOLERANCE * new
        ended &= not curved
        model, loss = candidate, new
        damping = damping * 10 if curved else max(damping / 10, _MIN_DAMPING)
        if ended:
            break
        if gained < _NEARLY_LINEAR * predicted_fall:
            slopes = slopes_of(model, measured)
        statistics = slopes.statistics(model)
    return model


def equalised(measured: MeasuredPushes, model: AnalyticPush) -> MeasuredPushes:
    """The pushes with weights: the inverse of each push's error and of the mean error at each distance from the path,
    within bounds, 1 on average.

    A deep push that meets an old groove has tens of times the error of a shallow one: without weights, few such pushes
    would dominate. Likewise, errors of the base below the tool would hide small displacements far from it.
    """
    error, seen = residual(model, measured), measured.valid
    ring, rings = np.digitize(distance_from_path(measured.scene), _RINGS), len(_RINGS) + 1
    squared = (_push_weights(error, measured) * np.square(error))[seen]
    of_ring = np.bincount(ring[seen], squared, rings) / np.maximum(np.bincount(ring[seen], minlength=rings), 1)
    place = 1 / np.maximum(of_ring, of_ring.max() / _MAX_RING_RATIO)[ring]
    weight = (_push_weights(np.sqrt(place) * error, measured) * place).astype(np.float32)
    return replace(measured, weight=weight / weight[seen].mean())


def _push_weights(residuals: Array, measured: MeasuredPushes) -> Array:
    """Weights [B, 1, 1] of pushes with these residuals [B, H, W]."""
    error = mean_squared_error(residuals, measured)
    return np.clip(np.median(error) / np.maximum(error, 1e-12), 1 / _MAX_WEIGHT_RATIO, _MAX_WEIGHT_RATIO)[:, None, None]


def _start(measured: MeasuredPushes) -> Array:
    return first_model(measured.scene).base


def _prior(model: AnalyticPush, loss: float) -> Array:
    """Curvature [P, P] of the Gaussian prior on the base's parameters."""
    prior = np.zeros((len(model.vector), len(model.vector)))
    for i, name in enumerate(BASE):
        width = _PROFILE_PRIOR_WIDTH_MM * KNOTS[PROFILE.index(name)] if name in PROFILE else _PRIORS[name][0]
        prior[i, i] = 1 / width**2
    return _PRIOR_WEIGHT * loss * prior


def _offset(model: AnalyticPush, start: Array) -> Array:
    """Distance of each parameter from its start."""
    offset = model.vector.copy()
    offset[: len(start)] -= start
    return offset


def _cost(offset: Array, prior: Array) -> float:
    return float(offset @ prior @ offset)


def _bounds(model: AnalyticPush) -> tuple[Array, Array]:
    """Lower and upper bounds of the model's parameters."""
    low, high = np.full(len(model.vector), -np.inf), np.full(len(model.vector), np.inf)
    for i, name in enumerate(BASE):
        low[i], high[i] = _PROFILE_RANGE_MM if name in PROFILE else _PRIORS[name][1:]
    # Unsigned quantities are bounded by zero; otherwise a zero effect would be fitted negative in half of the tables.
    quantities = [quantity for mechanism in model.mechanisms for quantity in mechanism.quantities]
    low[len(BASE) :][[not quantity.signed for quantity in quantities]] = 0.0
    return low, high


def _loss(model: AnalyticPush, measured: MeasuredPushes) -> float:
    return float(action_losses(model, measured).mean())
