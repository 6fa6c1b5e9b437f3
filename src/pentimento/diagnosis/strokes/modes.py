"""Residual modes of strokes, and the generic modulator: curves from covariates to modes (docs/diagnosis.md §9).

Each mode that depends on a covariate gets a piecewise linear curve over it, constant beyond the outer knots. All curves
are fitted together at the model, from the same sums as fits, with a ridge chosen by cross-validation over blocks. The
modulator states what an explanation would gain. Unlike a named cause it has no warrant outside the conditions of its
fit.
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
from pentimento.diagnosis.residual_structure import ModeScores, Structure, Unexplained, find_structure
from pentimento.diagnosis.score import folds
from pentimento.diagnosis.strokes.jacobian import linearise_rows
from pentimento.diagnosis.strokes.measured import Measured, path_covariates
from pentimento.diagnosis.strokes.model import Model
from pentimento.diagnosis.strokes.predict import action_losses
from pentimento.dynamics.strokes.mechanisms.geometry import bleed, tangent
from pentimento.dynamics.strokes.simulation import Mechanism, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark

Array = NDArray[Any]

MODES = ("amplitude", "width", "tangential", "normal", "canvas_x", "canvas_y", "blur")
_KNOTS = (0.0, 1 / 3, 2 / 3, 1.0)
"""Quantiles of the covariate."""
_RIDGES = (0.01, 0.1, 1.0, 10.0)
"""Ridge candidates, relative to each curve's own curvature; without any gain there is no modulation."""
_STEPS = 2
_DRAWS = 1999


class AllModes(Mechanism):
    """All modes at once, by an amount of each that is equal for all strokes."""

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


def mode_scores(model: Model, measured: Measured) -> ModeScores:
    """Amounts of the modes in the residuals of a model."""
    curvature, slope, error = linearise_rows(model.plus(AllModes(torch.zeros(len(MODES)), {})), measured)
    energy = np.einsum("bmm->bm", curvature[:, -len(MODES) :, -len(MODES) :])
    return ModeScores(slope[:, -len(MODES) :] / np.maximum(energy, 1e-12), energy, float(error.mean()))


def structured_residual(model: Model, measured: Measured, columns: Mapping[str, Array], *, seed: int) -> Structure:
    """Dependences of the modes on covariates.

    Args:
        columns: covariates, [B] each, without gaps.
    """
    return find_structure(MODES, mode_scores(model, measured), columns, action=measured.action, seed=seed)


class Modulation(Mechanism):
    """Marks whose modes change by an amount of each stroke's own, ``modulation_<mode>`` among the covariates, plus a
    common one, ``values``; both in the quantities' units.
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
        # The base's edge may be harder than bleeding's hardest edge: scale the base's own softness.
        return bleed(moved, blur.expand_as(still), still)._replace(softness=mark.softness * torch.exp(blur))


class Curve(NamedTuple):
    """One mode over one covariate."""

    mode: str
    covariate: str
    knots: Array
    """[K], ascending."""
    amounts: Array
    """[K] at the knots, in typical sizes, with mean 0 over the strokes of the fit; constant beyond the outer knots."""


class Modulator(NamedTuple):
    """Curves; those of one mode add up. Empty if nothing generalises to left-out blocks."""

    curves: tuple[Curve, ...]

    def amounts(self, measured: Measured) -> Array:
        """Amount of each stroke in each mode, typical sizes, [B, M]; 0 where a covariate is unknown."""
        found = np.zeros((len(measured), len(MODES)))
        for curve in self.curves:
            found[:, MODES.index(curve.mode)] += (
                _hats(_covariate(measured, curve.covariate), curve.knots) @ curve.amounts
            )
        return found


class Generic(NamedTuple):
    """Gain of a modulator on the test split."""

    modulator: Modulator
    losses: Array
    """Error of each action of the test split with the modulator, sRGB."""
    gain: float
    """Share of the model's error on the test split that it removes; negative where it harms."""
    gain_interval: tuple[float, float]
    """95 % interval, by resampling actions."""
    gain_of: dict[tuple[str, str], float]
    """The gain of each (mode, covariate) alone."""


def evaluate_modulator(
    model: Model, known: Measured, test_split: Measured, *, left: Sequence[Unexplained], seed: int
) -> Generic:
    """Fit a modulator to unexplained structure and measure it on the test split.

    Args:
        model: the extended model, fitted to ``known``.
        known: strokes outside the test split.
        test_split: strokes.
        left: significant pairs, strongest first.
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
    """The model with the modulator, and the strokes with the amounts that it reads, as arguments of ``residual``."""
    typical = np.array([quantity.typical for quantity in Modulation.quantities])
    amounts = modulator.amounts(measured) * typical
    columns = {_column(mode): amounts[:, m] for m, mode in enumerate(MODES)}
    nothing = torch.zeros(len(MODES), dtype=torch.float64)
    return model.plus(Modulation(nothing, {})), replace(measured, covariates=measured.covariates | columns)


def fit_modulator(model: Model, measured: Measured, pairs: Sequence[tuple[str, str]], seed: int) -> Modulator:
    """Fit curves for pairs of mode and covariate, by Gauss-Newton steps with a ridge.

    The ridge is the one whose curves predict left-out blocks best. If none predicts them better than no curve, the
    modulator is empty.
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
            break  # too non-linear: keep the previous step
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
    """Weights [B, K] of the knots at the values: linear between knots, constant beyond; 0 for NaN."""
    at = np.clip(np.nan_to_num(values, nan=knots[0]), knots[0], knots[-1])
    left = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(knots) - 2)
    share = (at - knots[left]) / (knots[left + 1] - knots[left])
    hats = np.zeros((len(values), len(knots)))
    rows = np.arange(len(values))
    hats[rows, left], hats[rows, left + 1] = 1 - share, share
    hats[~np.isfinite(values)] = 0.0
    return hats


def _design(shapes: Sequence[tuple[str, str, Array]], columns: dict[str, Array]) -> tuple[Array, Array]:
    """[B, M, P]: effect of the curves' amounts on each stroke's modes, centred over the strokes with known covariate;
    and the centres [P].
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
    """J^T J [B, P, P] and J^T r [B, P] of the curves' amounts; rows of one action share a weight of 1."""
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
    """The step that minimises the quadratic with a ridge on theta."""
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
    """Curves from amounts at the knots [P] relative to the centres [P]."""
    curves, at = [], 0
    for mode, name, knots in shapes:
        own = slice(at, at + len(knots))
        curves.append(Curve(mode, name, knots, theta[own] - average[own] @ theta[own]))
        at += len(knots)
    return Modulator(tuple(curves))
