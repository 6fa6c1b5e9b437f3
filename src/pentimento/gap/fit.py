"""Least squares: Gauss-Newton with Levenberg's damping on the sum over actions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.gap.foretell import BASE, Model, Statistics, linearise, mean_squared_error, residual
from pentimento.gap.measured import Measured

Array = NDArray[Any]

_RIDGE = 1e-8
_HOLD = 0.01
_LIKELY_OFFSET = 0.03  # linear light
_ENOUGH = 5e-4
"""Relative fall of the error below which a fit has ended."""
_LONGEST = {"log_softness": 0.5, "log_blur_px": 0.4, "beta_mm": 0.5, "amplitude": 0.3}
_RANGE = {
    "alpha": (-0.5, 10.0),
    "saturation_mm": (-5.0, 5.0),
    "beta_mm": (0.05, 50.0),
    "log_softness": (np.log(0.03), np.log(4)),
    "amplitude": (0.05, 1.0),
    "log_blur_px": (np.log(0.25), np.log(4)),
    "start_mm": (-4.0, 4.0),
    "end_mm": (-4.0, 4.0),
    "side_mm": (-1.0, 1.0),
}


def first_model(measured: Measured) -> Model:
    """The base before any fit: half-width from the inked area, no dependence on press."""
    samples = measured.samples
    area = samples.ink.flatten(1).sum(1).double() / samples.pixels_per_m.double() ** 2
    length = samples.path[..., 1:3].diff(dim=1).norm(dim=-1).sum(1).double()
    # A round end adds its disc: area = 2 w L + pi w^2.
    half = ((length**2 + np.pi * area).sqrt() - length) / np.pi
    half_mm = max(float(half.median()) * 1e3, 0.2)
    start = {name: 0.0 for name in BASE} | {
        "beta_mm": half_mm,
        "log_softness": np.log(0.3),
        "amplitude": 0.9,
        "log_blur_px": np.log(0.7),
    }
    return Model(np.array([start[name] for name in BASE]), np.zeros((int(measured.paint.max()) + 1, 3)), ())


def fit(model: Model, measured: Measured, iterations: int = 30) -> Model:
    """The model whose foretold photographs are nearest to the measured, by mean squared error.

    A paint's colour and the amplitude can hardly be told apart on blank paper: offsets of colour are held near 0.
    """
    loss = _loss(model, measured)
    hold = _HOLD * loss / _LIKELY_OFFSET**2
    loss += hold * np.square(model.color_offset).sum()
    damping = 1e-3
    low, high = _bounds(model)
    reach = _longest_steps(model)
    for _ in range(iterations):
        near = np.maximum(low, model.vector - reach), np.minimum(high, model.vector + reach)
        statistics = linearise(model, measured)
        improved = False
        for _ in range(5):
            candidate = model.at(_step(model, statistics, damping, hold, *near))
            new = _loss(candidate, measured) + hold * np.square(candidate.color_offset).sum()
            if new < loss:
                improved = True
                break
            damping = max(damping * 10, 1e-3)
        if not improved:
            break
        gained, model, loss, damping = 1 - new / loss, candidate, new, max(damping / 10, 1e-7)
        if gained < _ENOUGH:
            break
    return model


def _step(model: Model, statistics: Statistics, damping: float, hold: float, low: Array, high: Array) -> Array:
    """All numbers after a damped Gauss-Newton step; those that would leave their range stay at its end."""
    curvature, slope = statistics.curvature.mean(0), statistics.slope.mean(0)
    held = np.zeros(len(slope))
    held[len(model.base) : model.nuisances] = hold
    slope = slope - held * model.vector
    curvature = curvature + np.diag(held)
    diagonal = np.diag(curvature)
    damped = curvature + np.diag(damping * diagonal + _RIDGE * diagonal.max() + 1e-15)
    now, new = model.vector, model.vector
    free = np.ones(len(slope), bool)
    for _ in range(len(slope)):
        moved = new[~free] - now[~free]
        step = np.linalg.solve(damped[np.ix_(free, free)], slope[free] - damped[np.ix_(free, ~free)] @ moved)
        new = new.copy()
        new[free] = now[free] + step
        outside = free & ((new < low) | (new > high))
        if not outside.any():
            break
        new = np.clip(new, low, high)
        free &= ~outside
    return new


def _bounds(model: Model) -> tuple[Array, Array]:
    """Where the model's numbers mean something."""
    low, high = np.full(len(model.vector), -np.inf), np.full(len(model.vector), np.inf)
    for i, name in enumerate(BASE):
        low[i], high[i] = _RANGE[name]
    colors = slice(len(model.base), model.nuisances)
    low[colors], high[colors] = -0.2, 0.2
    return low, high


def _longest_steps(model: Model) -> Array:
    """How far each number may go in one iteration: some act far from linearly."""
    reach = np.full(len(model.vector), np.inf)
    for i, name in enumerate(BASE):
        reach[i] = _LONGEST.get(name, np.inf)
    reach[model.nuisances :] = 1.0  # of what is typical
    return reach


def _loss(model: Model, measured: Measured) -> float:
    return float(mean_squared_error(residual(model, measured), measured).mean())
