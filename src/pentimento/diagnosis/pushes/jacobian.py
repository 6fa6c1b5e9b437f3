"""How what the analytic model foretells changes with each of its numbers, summed up by action (docs/diagnosis.md §3).

Differences, each from the stage on at which its number acts: what a number of the surface does needs no second look at
the contact.
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
from pentimento.dynamics.pushes.analytic import BASE, CONTACT, HEAP, KEPT, AnalyticPush, heap, keep, settle, touch
from pentimento.dynamics.pushes.analytic_scene import PushScene

Array = NDArray[Any]
_R = TypeVar("_R")

_STEP = 0.005
_MAX_ROWS_AT_ONCE = 60
MM = 1e3
_STAGE = {"command": 0, "contact": 0, "material": 2, "surface": 3}


def residual(model: AnalyticPush, measured: MeasuredPushes) -> Array:
    """Measured less foretold, habits included, millimetres float32[B, H, W]; 0 where nothing was measured."""
    return np.concatenate(_in_batches(lambda some: _residual(model, measured.pick(some)), len(measured)))


def _residual(model: AnalyticPush, measured: MeasuredPushes) -> Array:
    missed = measured.after - measured.scene.before - model.change(measured.scene)
    return np.where(measured.valid, missed * np.float32(MM) - measured.habit, 0)


def mean_squared_error(residuals: Array, measured: MeasuredPushes) -> Array:
    """Of each row, over what was measured of its window: mm², [B]."""
    return np.asarray(np.square(residuals).sum((1, 2)) / measured.valid.sum((1, 2)))


def action_losses(model: AnalyticPush, measured: MeasuredPushes) -> Array:
    """Weighted mean squared error of each action over its rows, mm², in the order of the actions' numbers."""
    weighted = np.sqrt(measured.weight) * residual(model, measured)
    return by_action(mean_squared_error(weighted, measured), measured.action)


@dataclass(frozen=True)
class Slopes:
    """The Jacobian itself, weighted: a model near to that at which it was taken may do without its own."""

    measured: MeasuredPushes
    batches: tuple[Array, ...]
    """Millimetres float32[B, P, H W] of a few rows each."""
    curvature: Array
    """Of each row, J^T J [B, P, P]."""

    def of(self, columns: Array) -> Slopes:
        """In these numbers alone, in their order."""
        batches = tuple(slopes[:, columns] for slopes in self.batches)
        return replace(self, batches=batches, curvature=self.curvature[:, columns][:, :, columns])

    def statistics(self, model: AnalyticPush) -> Statistics:
        """With the residuals of this model, as ``linearise`` has them."""
        rest = _in_batches(lambda some: _weighted_residual(model, self.measured.pick(some)), len(self.measured))
        slope = np.concatenate([_slope(*pair) for pair in zip(self.batches, rest, strict=True)])
        energy = np.concatenate([np.square(missed).sum(1) for missed in rest])
        rows = _a_pixel((self.curvature, slope, energy), self.measured)
        return Statistics(*(by_action(values, self.measured.action) for values in rows))


def slopes_of(model: AnalyticPush, measured: MeasuredPushes) -> Slopes:
    """The Jacobian of the foretold heights in all numbers of the model."""

    def of(some: slice) -> tuple[Array, Array]:
        slopes = _weighted_slopes(model, measured.pick(some))
        return slopes, _curvature(slopes)

    batches, curvature = zip(*_in_batches(of, len(measured)), strict=True)
    return Slopes(measured, batches, np.concatenate(curvature))


def linearise(model: AnalyticPush, measured: MeasuredPushes) -> Statistics:
    """Jacobian of the foretold heights in all numbers of the model, summed up by action."""
    return Statistics(*(by_action(values, measured.action) for values in linearise_rows(model, measured)))


def linearise_rows(model: AnalyticPush, measured: MeasuredPushes) -> tuple[Array, Array, Array]:
    """The same of each row: J^T J [B, P, P], J^T r [B, P], r^T r [B], over its number of measured pixels; mm²."""
    parts = _in_batches(lambda some: _row_statistics(model, measured.pick(some)), len(measured))
    curvature, slope, energy = (np.concatenate(values) for values in zip(*parts, strict=True))
    return curvature, slope, energy


def derivatives(model: AnalyticPush, scene: PushScene) -> Array:
    """Of the change of height by each number of ``model.vector``, metres float32[P, B, H, W]."""
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
    """The results for a few rows at a time, on all threads; as many at once as memory allows, for between two compiled
    functions threads wait for each other.
    """
    threads = get_num_threads()
    rounds = math.ceil(rows / (threads * _MAX_ROWS_AT_ONCE))
    return in_batches(function, rows, math.ceil(rows / (threads * rounds)), threads)


def _stage(name: str) -> int:
    return next((stage for stage, names in enumerate((CONTACT, HEAP, KEPT)) if name in names), 3)


def _row_statistics(model: AnalyticPush, measured: MeasuredPushes) -> tuple[Array, Array, Array]:
    slopes, rest = _weighted_slopes(model, measured), _weighted_residual(model, measured)
    return _a_pixel((_curvature(slopes), _slope(slopes, rest), np.square(rest).sum(1)), measured)


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


def _a_pixel(sums: tuple[Array, Array, Array], measured: MeasuredPushes) -> tuple[Array, Array, Array]:
    """Sums over each row's pixels, over its number of measured ones."""
    pixels = measured.valid.sum((1, 2)).astype(np.float64)
    curvature, slope, energy = sums
    return curvature / pixels[:, None, None], slope / pixels[:, None], energy / pixels
