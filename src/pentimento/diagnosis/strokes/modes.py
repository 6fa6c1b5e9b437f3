"""What is left when no known cause explains more: modes of the residual against everything that was recorded.

A mode is a way in which a mark can differ as a whole: amplitude, width, shifts along and across its path and along the
canvas's axes, blur. Each row's residual is projected on each mode, and the projections, weighted as they scatter (in
a short or shallow mark a mode is hardly seen), are tested against covariates by permutation of strokes, max-T over all
pairs. What the strongest covariate does is taken out of all modes before the
next is looked for: what merely goes along with it (time with wear, temperature with both) is not named beside it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pentimento.contracts.statistics import interval, resamples
from pentimento.diagnosis.residual_structure import Unexplained, structure
from pentimento.diagnosis.score import folds
from pentimento.diagnosis.strokes.jacobian import linearise_rows
from pentimento.diagnosis.strokes.measured import Measured, path_covariates
from pentimento.diagnosis.strokes.model import Model
from pentimento.diagnosis.strokes.predict import action_losses
from pentimento.dynamics.strokes.mechanisms.bleeding import bleed
from pentimento.dynamics.strokes.mechanisms.geometry import tangent
from pentimento.dynamics.strokes.simulation import Mechanism, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark

Array = NDArray[Any]

MODES = ("amplitude", "width", "tangential", "normal", "canvas_x", "canvas_y", "blur")
_KNOTS = (0.0, 1 / 3, 2 / 3, 1.0)
"""Quantiles of the covariate."""
_RIDGES = (0.01, 0.1, 1.0, 10.0)
"""Of each curve's own curvature; beside them no modulation at all."""
_STEPS = 2
_DRAWS = 1999


class AllModes(Mechanism):
    """All of them at once, by an amount of each that is the same for all strokes."""

    cause: ClassVar[str] = "modes"
    site = "density"
    quantities = (
        Quantity("amplitude", "1", 0.2),
        Quantity("width", "1", 0.2),
        Quantity("tangential", "m", 0.0005),
        Quantity("normal", "m", 0.0005),
        Quantity("canvas_x", "m", 0.0005),
        Quantity("canvas_y", "m", 0.0005),
        Quantity("blur", "1", 0.4),
    )

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        """See ``Mechanism``."""
        amplitude, width, tangential, normal, x, y, blur = self.values
        along = tangent(context.path)
        across = torch.stack([-along[..., 1], along[..., 0]], dim=-1)
        moved = mark._replace(
            points_m=mark.points_m + tangential * along + normal * across + torch.stack([x, y]),
            radius_m=mark.radius_m * torch.exp(width),
            density=mark.density * torch.exp(amplitude),
        )
        return bleed(moved, blur.expand_as(mark.radius_m), torch.zeros_like(mark.radius_m))


def mode_scores(model: Model, measured: Measured) -> tuple[Array, Array, float]:
    """Each row's residual in each mode, in typical sizes, [B, M]; the modes' own energies [B, M]; and the mean error
    of the rows.
    """
    curvature, slope, error = linearise_rows(model.plus(AllModes(torch.zeros(len(MODES)), {})), measured)
    own = np.einsum("bmm->bm", curvature[:, -len(MODES) :, -len(MODES) :])
    return slope[:, -len(MODES) :] / np.maximum(own, 1e-12), own, float(error.mean())


def unexplained(
    model: Model, measured: Measured, columns: Mapping[str, Array], seed: int
) -> tuple[list[Unexplained], Array, list[str]]:
    """What is significant, and all statistics |t| [M, covariates] with the covariates' names, for the heat map.

    Args:
        columns: covariates, [B] each, without gaps.
    """
    return structure(MODES, *mode_scores(model, measured), columns, measured.action, seed)


class Modulation(Mechanism):
    """Marks with their modes changed by an amount of each stroke's own, ``modulation_<mode>`` among the covariates, and
    by one for all, ``values``; both in the quantities' units.
    """

    cause: ClassVar[str] = "modulation"
    site = "density"
    driving_covariate = "anything"
    quantities = AllModes.quantities

    @property
    def active(self) -> bool:
        """Always: each stroke has an amount of its own."""
        return True

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        zero = torch.zeros_like(context.path[..., 0, 0])
        amplitude, width, tangential, normal, x, y, blur = (
            (context.covariates.get(_column(mode), zero) + value)[..., None]
            for mode, value in zip(MODES, self.values, strict=True)
        )
        along = tangent(context.path)
        across = torch.stack([-along[..., 1], along[..., 0]], dim=-1)
        shift = tangential[..., None] * along + normal[..., None] * across
        moved = mark._replace(
            points_m=mark.points_m + shift + torch.stack([x, y], dim=-1),
            radius_m=mark.radius_m * torch.exp(width),
            density=mark.density * torch.exp(amplitude),
        )
        still: Tensor = torch.zeros_like(mark.radius_m)
        # The base's edge may be harder than the hardest that bleeding knows; without blur it stays as it is.
        return bleed(moved, blur.expand_as(still), still)._replace(softness=mark.softness * torch.exp(blur))


class Curve(NamedTuple):
    """One mode over one covariate."""

    mode: str
    covariate: str
    knots: Array
    """[K] rising."""
    amounts: Array
    """[K] at the knots, in the mode's typical sizes, 0 on average over the strokes that it was fitted to: what is the
    same for all is the base's. Level beyond the first and the last."""


class Modulator(NamedTuple):
    """Curves that add up where they are of one mode; none if nothing holds on blocks left out."""

    curves: tuple[Curve, ...]

    def amounts(self, measured: Measured) -> Array:
        """Of each stroke in each mode, typical sizes, [B, M]; nothing where a covariate is unknown."""
        found = np.zeros((len(measured), len(MODES)))
        for curve in self.curves:
            found[:, MODES.index(curve.mode)] += (
                _hats(_covariate(measured, curve.covariate), curve.knots) @ curve.amounts
            )
        return found


class Generic(NamedTuple):
    """What a modulator is worth on sealed strokes."""

    modulator: Modulator
    losses: Array
    """Mean squared error of each sealed action with it, sRGB."""
    gain: float
    """Share of the model's error on sealed strokes that it removes; below 0 where it harms."""
    gain_interval: tuple[float, float]
    """95 %, by resampling actions."""
    gain_of: dict[tuple[str, str], float]
    """The same of each (mode, covariate) by itself."""


def generic(model: Model, known: Measured, test_split: Measured, left: Sequence[Unexplained], seed: int) -> Generic:
    """Fit a modulator to what is left unexplained and measure it on strokes that had no part in it.

    Args:
        model: the extended one, fitted to ``known``.
        known: with weights, as in fits.
        sealed: without.
        left: what depends on what, the strongest first.
        seed: of folds and resampling.
    """
    pairs = [(one.mode, one.covariate) for one in left]
    together = fit_modulator(model, known, pairs, seed)
    before, losses = action_losses(model, test_split), action_losses(*modulated(model, together, test_split))
    drawn = resamples(len(losses), _DRAWS, [seed, 15])
    bounds = interval(1 - losses[drawn].mean(1) / before[drawn].mean(1))
    alone = {}
    for pair in pairs:
        one = fit_modulator(model, known, [pair], seed)
        alone[pair] = float(1 - action_losses(*modulated(model, one, test_split)).mean() / before.mean())
    return Generic(together, losses, float(1 - losses.mean() / before.mean()), bounds, alone)


def modulated(model: Model, modulator: Modulator, measured: Measured) -> tuple[Model, Measured]:
    """The model with the modulator, and the strokes with the amounts that it reads: what ``residual`` and
    ``action_losses`` take.
    """
    typical = np.array([quantity.typical for quantity in Modulation.quantities])
    amounts = modulator.amounts(measured) * typical
    columns = {_column(mode): amounts[:, m] for m, mode in enumerate(MODES)}
    nothing = torch.zeros(len(MODES), dtype=torch.float64)
    return model.plus(Modulation(nothing, {})), replace(measured, covariates=measured.covariates | columns)


def fit_modulator(model: Model, measured: Measured, pairs: Sequence[tuple[str, str]], seed: int) -> Modulator:
    """Curves for pairs of mode and covariate, by Gauss-Newton at the model and a ridge.

    The ridge is the one whose curves, fitted to the other blocks, foretell left-out actions best; where none foretells
    them better than no curve, there is none.
    """
    empty = Modulator(())
    columns = {name: _covariate(measured, name) for _, name in pairs}
    shapes = [(mode, name, _knots_of(columns[name])) for mode, name in pairs]
    shapes = [shape for shape in shapes if len(shape[2]) > 1]
    if not shapes:
        return empty
    design, average = _design(shapes, columns)
    found, ridge = empty, None
    theta = np.zeros(design.shape[-1])
    for step in range(_STEPS):
        curvature, slope = _by_curves(*modulated(model, found, measured), design)
        if step == 0:
            ridge = _best_ridge(curvature, slope, measured, seed)
            if ridge is None:
                return empty
            hold = np.diag(curvature.sum(0)).copy()
        theta = theta + _solved(curvature.sum(0), slope.sum(0), ridge * hold, theta)
        better = _modulator(shapes, theta, average)
        if _loss(model, better, measured) >= _loss(model, found, measured):
            break  # too far from linear: what was found before stands
        found = better
    return found


def _loss(model: Model, modulator: Modulator, measured: Measured) -> float:
    return float(action_losses(*modulated(model, modulator, measured)).mean())


def _column(mode: str) -> str:
    return f"modulation_{mode}"


def _covariate(measured: Measured, name: str) -> Array:
    """[B]; NaN where unknown."""
    known = measured.covariates | path_covariates(measured)
    return known.get(name, np.full(len(measured), np.nan))


def _knots_of(values: Array) -> Array:
    known = values[np.isfinite(values)]
    return np.unique(np.quantile(known, _KNOTS)) if len(known) else np.zeros(0)


def _hats(values: Array, knots: Array) -> Array:
    """How much of the amount at each knot counts at the values, [B, K]: linear between, level beyond; 0 for NaN."""
    at = np.clip(np.nan_to_num(values, nan=knots[0]), knots[0], knots[-1])
    left = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(knots) - 2)
    share = (at - knots[left]) / (knots[left + 1] - knots[left])
    hats = np.zeros((len(values), len(knots)))
    rows = np.arange(len(values))
    hats[rows, left], hats[rows, left + 1] = 1 - share, share
    hats[~np.isfinite(values)] = 0.0
    return hats


def _design(shapes: Sequence[tuple[str, str, Array]], columns: dict[str, Array]) -> tuple[Array, Array]:
    """[B, M, P]: what each curve's amounts at its knots do to each stroke's modes, about the average stroke of which
    its covariate is known; and [P], what they do to that one.
    """
    size = sum(len(knots) for _, _, knots in shapes)
    rows = len(columns[shapes[0][1]])
    design, average, at = np.zeros((rows, len(MODES), size)), np.zeros(size), 0
    for mode, name, knots in shapes:
        known, own = np.isfinite(columns[name]), slice(at, at + len(knots))
        hats = _hats(columns[name], knots)
        average[own] = hats[known].mean(0)
        design[:, MODES.index(mode), own] = np.where(known[:, None], hats - average[own], 0.0)
        at += len(knots)
    return design, average


def _by_curves(model: Model, measured: Measured, design: Array) -> tuple[Array, Array]:
    """J^T J [B, P, P] and J^T r [B, P] of the curves' amounts; rows of one action share one vote."""
    curvature, slope, _ = linearise_rows(model, measured)
    m = len(MODES)
    _, group, count = np.unique(measured.action, return_inverse=True, return_counts=True)
    vote = 1 / count[group]
    of_modes = curvature[:, -m:, -m:] * vote[:, None, None]
    return (
        np.einsum("bmp,bmn,bnq->bpq", design, of_modes, design),
        np.einsum("bmp,bm->bp", design, slope[:, -m:] * vote[:, None]),
    )


def _solved(curvature: Array, slope: Array, hold: Array, theta: Array) -> Array:
    """The step that minimises the quadratic with the ridge on all of theta."""
    held = curvature + np.diag(hold + 1e-9 * np.diag(curvature).max() + 1e-15)
    step: Array = np.linalg.solve(held, slope - hold * theta)
    return step


def _best_ridge(curvature: Array, slope: Array, measured: Measured, seed: int) -> float | None:
    fold = folds(measured.block, seed)
    gains = dict.fromkeys(_RIDGES, 0.0)
    nothing = np.zeros(slope.shape[1])
    for k in np.unique(fold):
        out = fold == k
        if out.all():
            continue
        fitted, held = curvature[~out].sum(0), curvature[out].sum(0)
        for ridge in _RIDGES:
            step = _solved(fitted, slope[~out].sum(0), ridge * np.diag(fitted), nothing)
            gains[ridge] += float(2 * slope[out].sum(0) @ step - step @ held @ step)
    best = max(gains, key=lambda ridge: gains[ridge])
    return best if gains[best] > 0 else None


def _modulator(shapes: Sequence[tuple[str, str, Array]], theta: Array, average: Array) -> Modulator:
    """Curves from amounts at knots [P] about those of the average stroke [P]."""
    curves, at = [], 0
    for mode, name, knots in shapes:
        own = slice(at, at + len(knots))
        curves.append(Curve(mode, name, knots, theta[own] - average[own] @ theta[own]))
        at += len(knots)
    return Modulator(tuple(curves))
