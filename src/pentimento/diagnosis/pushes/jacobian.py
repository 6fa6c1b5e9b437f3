"""Residuals of the analytic push model and their Jacobian, summed by action (docs/diagnosis.md §3).

The Jacobian is computed by finite differences, each from the stage at which its parameter acts: a parameter of the
surface does not need the contact again.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numba import get_num_threads
from numpy.typing import NDArray

from pentimento.diagnosis.batches import in_batches
from pentimento.diagnosis.gauss_newton import Statistics, by_action
from pentimento.diagnosis.pushes.measured import MeasuredPushes
from pentimento.planning.pushes.analytic.model import BASE, CONTACT, HEAP, KEPT, AnalyticPush, heap, keep, settle, touch
from pentimento.planning.pushes.analytic.scene import PushScene

Array = NDArray[Any]

_R = TypeVar("_R")
_STEP = 0.005
"""Finite-difference step, in the units of ``AnalyticPush.vector``."""
_MAX_ROWS_AT_ONCE = 60
"""Rows of one batch, bounded by memory."""
MM = 1e3
"""Millimetres in a metre: residuals are in millimetres."""
_STAGE = {"command": 0, "contact": 0, "material": 2, "surface": 3}
"""First stage that a mechanism of each site changes: contact, heap, indentation, surface."""


def residual(model: AnalyticPush, measured: MeasuredPushes) -> Array:
    """Measured minus predicted height, learned residual included, mm float32[B, H, W]; 0 where nothing was measured."""
    return np.concatenate(_in_batches(lambda some: _residual(model, measured.pick(some)), len(measured)))


def _residual(model: AnalyticPush, measured: MeasuredPushes) -> Array:
    error = measured.after - measured.scene.before - model.change(measured.scene)
    return np.where(measured.valid, error * np.float32(MM) - measured.learned_mm, 0)


def mean_squared_error(residuals: Array, measured: MeasuredPushes) -> Array:
    """Of each row, over the measured pixels of its window: mm², [B]."""
    return np.asarray(np.square(residuals).sum((1, 2)) / measured.valid.sum((1, 2)))


def action_losses(model: AnalyticPush, measured: MeasuredPushes) -> Array:
    """Weighted mean squared error of each action over its rows, mm², in the order of the actions' numbers."""
    weighted = np.sqrt(measured.weight) * residual(model, measured)
    return by_action(mean_squared_error(weighted, measured), measured.action)


@dataclass(frozen=True)
class Slopes:
    """The weighted Jacobian; models near the one at which it was computed may reuse it."""

    measured: MeasuredPushes
    batches: tuple[Array, ...]
    """Millimetres float32[B, P, H W], a few rows each."""
    curvature: Array
    """J^T J of each row, [B, P, P]."""

    def of(self, columns: Array) -> Slopes:
        """The Jacobian in these parameters alone, in their order."""
        batches = tuple(slopes[:, columns] for slopes in self.batches)
        return replace(self, batches=batches, curvature=self.curvature[:, columns][:, :, columns])

    def statistics(self, model: AnalyticPush) -> Statistics:
        """Statistics with the residuals of this model, as from ``linearise``."""
        residuals = _in_batches(lambda some: _weighted_residual(model, self.measured.pick(some)), len(self.measured))
        slope = np.concatenate([_slope(*pair) for pair in zip(self.batches, residuals, strict=True)])
        energy = np.concatenate([np.square(error).sum(1) for error in residuals])
        rows = _per_pixel(Statistics(self.curvature, slope, energy), self.measured)
        return Statistics(*(by_action(values, self.measured.action) for values in rows))


def slopes_of(model: AnalyticPush, measured: MeasuredPushes) -> Slopes:
    """Jacobian of the predicted heights in all parameters of the model."""

    def of(some: slice) -> tuple[Array, Array]:
        slopes = _weighted_slopes(model, measured.pick(some))
        return slopes, _curvature(slopes)

    batches, curvature = zip(*_in_batches(of, len(measured)), strict=True)
    return Slopes(measured, batches, np.concatenate(curvature))


def linearise(model: AnalyticPush, measured: MeasuredPushes) -> Statistics:
    """Jacobian of the predicted heights in all parameters of the model, summed by action."""
    return Statistics(*(by_action(values, measured.action) for values in linearise_rows(model, measured)))


def linearise_rows(model: AnalyticPush, measured: MeasuredPushes) -> Statistics:
    """The same for each row: J^T J [B, P, P], J^T r [B, P], r^T r [B], divided by its number of measured pixels;
    mm²."""
    parts = _in_batches(lambda some: _row_statistics(model, measured.pick(some)), len(measured))
    return Statistics(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def derivatives(model: AnalyticPush, scene: PushScene) -> Array:
    """Derivatives of the change of height by each parameter of ``model.vector``, metres float32[P, B, H, W]."""
    contact = touch(model, scene)
    kept = keep(model, scene, contact)
    still = settle(model, scene, contact, kept)
    stages = [_stage(name) for name in BASE]
    stages += [_STAGE[m.site] for m in model.mechanisms for _ in m.quantities]
    found = np.empty((len(stages), *still.shape), dtype=np.float32)
    for p, stage in enumerate(stages):
        moved = model.at(model.vector + _STEP * (np.arange(len(stages)) == p))
        touched = touch(moved, scene) if stage == 0 else heap(moved, scene, contact) if stage == 1 else contact
        stays = keep(moved, scene, touched) if stage in (0, 2) else kept
        np.subtract(settle(moved, scene, touched, stays), still, out=found[p])
        found[p] /= np.float32(_STEP)
    return found


def _in_batches(function: Callable[[slice], _R], rows: int) -> list[_R]:
    """Results for batches of rows, on all threads; each batch is as large as memory allows, because threads wait for
    each other between two compiled functions."""
    threads = get_num_threads()
    rounds = math.ceil(rows / (threads * _MAX_ROWS_AT_ONCE))
    return in_batches(function, rows, math.ceil(rows / (threads * rounds)), threads)


def _stage(name: str) -> int:
    return next((stage for stage, names in enumerate((CONTACT, HEAP, KEPT)) if name in names), 3)


def _row_statistics(model: AnalyticPush, measured: MeasuredPushes) -> Statistics:
    slopes, rest = _weighted_slopes(model, measured), _weighted_residual(model, measured)
    return _per_pixel(Statistics(_curvature(slopes), _slope(slopes, rest), np.square(rest).sum(1)), measured)


def _weighted_slopes(model: AnalyticPush, measured: MeasuredPushes) -> Array:
    """Millimetres float32[B, P, H W]."""
    slopes = derivatives(model, measured.scene)
    slopes *= np.sqrt(measured.weight) * measured.valid * np.float32(MM)
    return slopes.reshape(len(slopes), len(measured), -1).transpose(1, 0, 2)


def _weighted_residual(model: AnalyticPush, measured: MeasuredPushes) -> Array:
    """Millimetres float32[B, H W]."""
    return (_residual(model, measured) * np.sqrt(measured.weight) * measured.valid).reshape(len(measured), -1)


def _curvature(slopes: Array) -> Array:
    return slopes @ slopes.transpose(0, 2, 1)


def _slope(slopes: Array, rest: Array) -> Array:
    return np.einsum("bpn,bn->bp", slopes, rest)


def _per_pixel(sums: Statistics, measured: MeasuredPushes) -> Statistics:
    """Sums over each row's pixels, divided by its number of measured pixels."""
    pixels = measured.valid.sum((1, 2)).astype(np.float64)
    return Statistics(sums.curvature / pixels[:, None, None], sums.slope / pixels[:, None], sums.energy / pixels)
