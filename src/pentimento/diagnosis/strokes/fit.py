"""Fits of stroke models: Levenberg-Marquardt on the sums over actions, with a Gaussian prior on the base."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.gauss_newton import Statistics, damped_step, predicted_decrease
from pentimento.diagnosis.score import paired_p
from pentimento.diagnosis.strokes.jacobian import linearise
from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.model import BASE, SLABS, WIDTHS, Model, UnevenEnds
from pentimento.diagnosis.strokes.predict import action_losses

Array = NDArray[Any]

_PRIOR_WEIGHT = 0.01
"""Cost of a parameter one prior scale from its mean, as a share of the error."""
_PRIOR_SCALE = dict.fromkeys(SLABS[1:], 0.3) | {
    "density_by_press": 0.5,
    "edge_by_press": 0.5,
    "ends_mm": 3.0,
    "side_mm": 0.5,
    "outward_mm": 0.3,
    "ends_widening": 0.5,
    "mixing": 0.5,
}
_PRIOR_BEND = 0.1
"""Prior scale of the half-width curve's second difference, in half-widths."""
_PRIOR_COLOR = 0.3  # linear light; a told colour is a guess
_ENOUGH = 1e-4
"""Relative decrease of the error below which a fit ends."""
_FIRST_DAMPING = 1e-3  # of a number's own curvature
_LONGEST = dict.fromkeys(SLABS, 0.3) | {"log_edge_px": 0.3, "ends_widening": 0.3, "mixing": 0.3}
"""Largest step of one iteration, in the parameter's unit."""
_LONGEST_WIDTH_MM = 0.7
_RANGE = (
    dict.fromkeys(WIDTHS, (0.02, 50.0))
    | dict.fromkeys(SLABS, (-1.0, 1.5))
    | {
        "density_by_press": (-2.0, 2.0),
        "edge_by_press": (-2.0, 2.0),
        "log_edge_px": (np.log(0.3), np.log(6)),
        "ends_mm": (-50.0, 50.0),
        "side_mm": (-1.0, 1.0),
        "outward_mm": (-1.0, 1.0),
        "ends_widening": (-1.0, 1.0),
        "mixing": (-2.5, 0.7),
    }
)
"""Bounds of the base's parameters."""
_MAX_OF_USUAL = 3.0
"""Huber's limit: an action's error counts as at most so many times the median."""
_FARTHEST_ENDS = 0.5
"""Half-widths by which both ends may miss their command."""
_MAX_UNEVEN = 0.2
"""Half-widths by which each of two uneven ends may miss it."""
_MAX_WIDENED = 3.0  # times what is typical
_FLATTEST = 1e-6  # m of press: below it all presses count as one
_MIXING_START = -0.4
_MIXING_P = 0.01
"""p below which paint mixes otherwise than in linear light."""
_MIN_MIXING = 0.1
"""Share of the error that such a mixing must remove."""


def first_model(measured: Measured) -> Model:
    """The base before any fit: half-width from the inked area, no dependence on press, a hard edge."""
    samples = measured.samples
    area = samples.ink.flatten(1).sum(1).double() / samples.pixels_per_m.double() ** 2
    length = samples.path[..., 1:3].diff(dim=1).norm(dim=-1).sum(1).double()
    # A round end adds its disc: area = 2 w L + pi w^2.
    half = ((length**2 + np.pi * area).sqrt() - length) / np.pi
    half_mm = max(float(half.median()) * 1e3, 0.1)
    start = dict.fromkeys(BASE, 0.0) | dict.fromkeys(WIDTHS, half_mm) | {SLABS[0]: 0.9, "log_edge_px": np.log(0.8)}
    press = (-samples.path[..., 3]).double().numpy()
    low, high = float(press.min()), float(press.max())
    if high - low < _FLATTEST:
        low, high = low - _FLATTEST, high + _FLATTEST
    return Model((low, high), np.array([start[name] for name in BASE]), np.zeros((measured.paints, 3)), ())


def fit(model: Model, measured: Measured, iterations: int = 40) -> Model:
    """Fit a model to measured strokes by weighted mean squared error.

    The prior holds parameters that the strokes leave open near the simplest base: a hard edge, a smooth curve of
    widths, paint as recorded.
    """
    statistics = linearise(model, measured)
    hold = _prior(model, _loss(statistics))
    loss = _loss(statistics) + _cost(model.vector, hold)
    damping = _FIRST_DAMPING
    low, high = _bounds(model)
    reach = _longest_steps(model)
    for _ in range(iterations):
        near = np.maximum(low, model.vector - reach), np.minimum(high, model.vector + reach)
        for _ in range(6):
            moved = damped_step(model.vector, model.vector, statistics, damping=damping, hold=hold, bounds=near)
            candidate = model.at(moved)
            new = _loss_of(candidate, measured) + _cost(candidate.vector, hold)
            if new < loss:
                break
            damping = max(damping * 10, _FIRST_DAMPING)
        else:
            break
        step, gained = candidate.vector - model.vector, loss - new
        # The difference between actual and predicted decrease of a full step estimates the decrease of the next one.
        surprise = abs(predicted_decrease(step, model.vector, statistics, hold) - gained)
        left = surprise if damping <= _FIRST_DAMPING else gained
        # A step at its limit has not converged, however small its decrease.
        cut_short = (np.abs(step) > 0.999 * reach).any()
        model, loss, damping = candidate, new, max(damping / 10, 1e-7)
        if min(gained, left) < _ENOUGH * loss and not cut_short:
            break
        statistics = linearise(model, measured)
    return model


def huber_weighted(measured: Measured, model: Model) -> Measured:
    """Weights for strokes: no action's error counts as more than ``_MAX_OF_USUAL`` times the median (Huber 1964)."""
    plain = replace(measured, weight=np.ones(len(measured)))
    losses = action_losses(model, plain)
    _, action = np.unique(measured.action, return_inverse=True)
    weight = np.minimum(_MAX_OF_USUAL * np.median(losses) / np.maximum(losses, 1e-30), 1.0)
    return replace(measured, weight=weight[action])


def stiffened(statistics: Statistics, model: Model, share: float) -> Statistics:
    """Statistics whose curvature includes a ``share`` of the prior's, for steps from the model's present parameters."""
    return statistics._replace(curvature=statistics.curvature + share * _prior(model, _loss(statistics)))


def _prior(model: Model, loss: float) -> Array:
    """Curvature [P, P] of the Gaussian prior on the base."""
    size = len(model.vector)
    rows = [np.eye(size)[BASE.index(name)] / likely for name, likely in _PRIOR_SCALE.items()]
    half_mm = float(model.base[: len(WIDTHS)].mean())
    for k in range(1, len(WIDTHS) - 1):
        bend = np.zeros(size)
        bend[k - 1 : k + 2] = 1, -2, 1
        rows.append(bend / (_PRIOR_BEND * half_mm))
    rows += [np.eye(size)[p] / _PRIOR_COLOR for p in range(len(BASE), model.nuisances)]
    held = np.stack(rows)
    return _PRIOR_WEIGHT * loss * held.T @ held


def _cost(away: Array, hold: Array) -> float:
    return float(away @ hold @ away)


def _bounds(model: Model) -> tuple[Array, Array]:
    """Lower and upper bounds of the model's parameters."""
    low, high = np.full(len(model.vector), -np.inf), np.full(len(model.vector), np.inf)
    for i, name in enumerate(BASE):
        low[i], high[i] = _RANGE[name]
    colors = slice(len(model.base), model.nuisances)
    low[colors], high[colors] = -0.5, 0.5
    half_mm = float(model.base[: len(WIDTHS)].mean())
    ends = BASE.index("ends_mm")
    low[ends], high[ends] = -_FARTHEST_ENDS * half_mm, _FARTHEST_ENDS * half_mm
    if any(isinstance(m, UnevenEnds) for m in model.mechanisms):
        uneven = model.columns_of(UnevenEnds.cause)
        shift = _MAX_UNEVEN * half_mm * 1e-3 / UnevenEnds.quantities[0].typical
        high[uneven] = shift, shift, _MAX_WIDENED, _MAX_WIDENED
        low[uneven] = -high[uneven]
    return low, high


def _longest_steps(model: Model) -> Array:
    """Largest step of each parameter in one iteration; some act far from linearly."""
    reach = np.full(len(model.vector), np.inf)
    for i, name in enumerate(BASE):
        reach[i] = _LONGEST_WIDTH_MM if name in WIDTHS else _LONGEST.get(name, np.inf)
    reach[model.nuisances :] = 1.0  # of what is typical
    return reach


def _loss(statistics: Statistics) -> float:
    return float(statistics.energy.mean())


def _loss_of(model: Model, measured: Measured) -> float:
    """``_loss`` without derivatives, in a quarter of the time."""
    return float(action_losses(model, measured).mean())


def choose_mixing(model: Model, measured: Measured, seed: int) -> Model:
    """The fitted base, or one in which paint and ground mix in another power of light where that surely fits better.

    A wrong mixing looks like paint pickup where strokes lie over older paint. For one dark ink on white paper the power
    is not identifiable, because the profile compensates for it; the base then keeps linear light.
    """
    other = fit(_mixing_by(model, _MIXING_START), measured)
    # Compare with linear light from the same start, so that only the mixing differs.
    rival = fit(_mixing_by(other, 0.0), measured)
    plain = min(model, rival, key=lambda each: float(linearise(each, measured).energy.mean()))
    before = linearise(plain, measured).energy
    removed = before - linearise(other, measured).energy
    sure = paired_p(removed, seed) < _MIXING_P and removed.mean() >= _MIN_MIXING * before.mean()
    return other if sure else plain


def _mixing_by(model: Model, mixing: float) -> Model:
    numbers = model.base.copy()
    numbers[BASE.index("mixing")] = mixing
    return replace(model, base=numbers)
