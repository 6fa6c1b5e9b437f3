"""Residuals of the analytic push model and their Jacobian, summed by action (docs/diagnosis.md §3).

The Jacobian is computed by finite differences, each from the stage at which its parameter acts: a parameter of the
surface does not need the contact again.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
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
_MOST_KEPT_BYTES = 400e6
"""Memory of the columns of earlier Jacobians (``KeptColumns``)."""
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
        return Statistics(*(by_action(values, self.measured.action) for values in self.rows(model)))

    def rows(self, model: AnalyticPush) -> Statistics:
        """The same for each row, as from ``linearise_rows``."""
        residuals = _in_batches(lambda some: _weighted_residual(model, self.measured.pick(some)), len(self.measured))
        slope = np.concatenate([_slope(*pair) for pair in zip(self.batches, residuals, strict=True)])
        energy = np.concatenate([np.square(error).sum(1) for error in residuals])
        return _per_pixel(Statistics(self.curvature, slope, energy), self.measured)


class KeptColumns:
    """Columns of the weighted Jacobian at the models that were asked for last.

    A search linearises one model with every candidate at 0, then fits it with some of them, each from the same point.
    A column depends on the parameter and on the mechanisms that act, not on those at 0, so it is computed once.
    """

    def __init__(self, measured: MeasuredPushes) -> None:
        """``measured``: the pushes, whose columns are kept."""
        self.measured = measured
        self._points: OrderedDict[Hashable, dict[Hashable, Array]] = OrderedDict()

    def slopes_of(self, model: AnalyticPush) -> Slopes:
        """Jacobian of the predicted heights in all parameters of the model."""
        measured, names, point = self.measured, _columns(model), point_of(model)
        known = self._points.setdefault(point, {})
        self._points.move_to_end(point)
        missing = [p for p, name in enumerate(names) if name not in known]
        if missing:
            parts = _in_batches(lambda some: _weighted_slopes(model, measured.pick(some), missing), len(measured))
            known |= {names[p]: np.concatenate([part[:, k] for part in parts]) for k, p in enumerate(missing)}
        batches = _in_batches(lambda some: np.stack([known[name][some] for name in names], axis=1), len(measured))
        while len(self._points) > 1 and self._bytes() > _MOST_KEPT_BYTES:
            self._points.popitem(last=False)
        return Slopes(measured, tuple(batches), np.concatenate([_curvature(slopes) for slopes in batches]))

    def __len__(self) -> int:
        """Number of models whose columns are kept."""
        return len(self._points)

    def _bytes(self) -> int:
        return sum(column.nbytes for columns in self._points.values() for column in columns.values())


def point_of(model: AnalyticPush) -> Hashable:
    """What the predictions of a model depend on: equal for models that differ only in mechanisms at 0."""
    acting = ((m.cause, m.values.tobytes(), *sorted(m.reference.items())) for m in model.active_mechanisms)
    return model.ball_radius_m, model.base.tobytes(), *acting


def _columns(model: AnalyticPush) -> list[Hashable]:
    """A name for each parameter, which tells its place among the mechanisms that act."""
    names: list[Hashable] = list(BASE)
    acting = 0
    for mechanism in model.mechanisms:
        reference = tuple(sorted(mechanism.reference.items()))
        names += [(mechanism.cause, reference, quantity.name, acting) for quantity in mechanism.quantities]
        acting += mechanism.active
    return names


def slopes_of(model: AnalyticPush, measured: MeasuredPushes) -> Slopes:
    """Jacobian of the predicted heights in all parameters of the model."""

    def of(some: slice) -> tuple[Array, Array]:
        slopes = _weighted_slopes(model, measured.pick(some))
        return slopes, _curvature(slopes)

    batches, curvature = zip(*_in_batches(of, len(measured)), strict=True)
    return Slopes(measured, batches, np.concatenate(curvature))


def linearise(model: AnalyticPush, measured: MeasuredPushes, kept: KeptColumns | None = None) -> Statistics:
    """Jacobian of the predicted heights in all parameters of the model, summed by action."""
    return Statistics(*(by_action(values, measured.action) for values in linearise_rows(model, measured, kept)))


def linearise_rows(model: AnalyticPush, measured: MeasuredPushes, kept: KeptColumns | None = None) -> Statistics:
    """The same for each row: J^T J [B, P, P], J^T r [B, P], r^T r [B], divided by its number of measured pixels; mm².

    Args:
        kept: of the same pushes; lends and keeps columns.
    """
    if kept is not None:
        return kept.slopes_of(model).rows(model)
    parts = _in_batches(lambda some: _row_statistics(model, measured.pick(some)), len(measured))
    return Statistics(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def derivatives(model: AnalyticPush, scene: PushScene, columns: Sequence[int] | None = None) -> Array:
    """Derivatives of the change of height by the parameters of ``model.vector``, metres float32[P, B, H, W].

    Args:
        columns: indices of the parameters; None: all.
    """
    contact = touch(model, scene)
    kept = keep(model, scene, contact)
    still = settle(model, scene, contact, kept)
    stages = [_stage(name) for name in BASE]
    stages += [_STAGE[m.site] for m in model.mechanisms for _ in m.quantities]
    columns = range(len(stages)) if columns is None else columns
    found = np.empty((len(columns), *still.shape), dtype=np.float32)
    for into, p in zip(found, columns, strict=True):
        stage = stages[p]
        moved = model.at(model.vector + _STEP * (np.arange(len(stages)) == p))
        touched = touch(moved, scene) if stage == 0 else heap(moved, scene, contact) if stage == 1 else contact
        stays = keep(moved, scene, touched) if stage in (0, 2) else kept
        np.subtract(settle(moved, scene, touched, stays), still, out=into)
        into /= np.float32(_STEP)
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


def _weighted_slopes(model: AnalyticPush, measured: MeasuredPushes, columns: Sequence[int] | None = None) -> Array:
    """Millimetres float32[B, P, H W]; ``columns`` as for ``derivatives``."""
    slopes = derivatives(model, measured.scene, columns)
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
