"""What noise makes of a push's error on the surface that the push met.

An arm that comes to its place within a third of a millimetre misses flat material by less than the wall of an old
groove, and a scanner sees a wall worse than what lies flat. Repeats tell how large both are on the surfaces that they
met, and so does a floor that is read off them (docs/diagnosis.md §7); on other surfaces the same noise is worth more,
or less.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.pushes.jacobian import MM, linearise_rows, residual
from pentimento.diagnosis.pushes.measured import MeasuredPushes
from pentimento.dynamics.pushes.analytic import AnalyticPush
from pentimento.dynamics.pushes.analytic_scene import PushScene
from pentimento.dynamics.pushes.mechanisms.mechanism import Mechanism, Motion, Quantity

Array = NDArray[Any]

_STEP_M = 1e-5
_RIDGE = 1e-6
"""Of the usual sensitivity: a push that hardly shows where the arm was says nothing of it."""
_SLOPES = (0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.5, 2.2)
"""Between which surfaces count as equally steep."""
_FEWEST = 100
"""Pixels: where fewer are as steep, they count as what is a little less so."""
_UNTOUCHED_MM = 0.02


class Scatter(Mechanism):
    """The tool acts beside its command."""

    cause: ClassVar[str] = "scatter"
    site = "command"
    driving_covariate = "nothing"
    quantities = (Quantity("along", "m", 0.0003), Quantity("across", "m", 0.0003), Quantity("lower", "m", 0.0003))

    def motion(self, motion: Motion, scene: PushScene) -> Motion:
        along, across, lower = self.values
        return motion._replace(
            along_m=motion.along_m + along, across_m=motion.across_m + across, lower_m=motion.lower_m + lower
        )


def by_scatter(model: AnalyticPush, scene: PushScene) -> Array:
    """How the change of height foretold by a model without ``Scatter`` grows with each of its quantities, mm per mm,
    float32[3, B, H, W].
    """
    still = model.change(scene)
    steps = _STEP_M * np.eye(len(Scatter.quantities))
    return np.stack([(model.plus(Scatter(step, {})).change(scene) - still) / np.float32(_STEP_M) for step in steps])


def error_by_noise(model: AnalyticPush, measured: MeasuredPushes, repeated: Sequence[Array]) -> Array:
    """Mean squared error of each row that the arm's scatter and the scanner's noise make, weighted as errors are,
    mm² [B].

    Args:
        repeated: rows of each of some actions, two or more of each.
    """
    return error_by_scatter(model, measured, repeated) + error_by_scanner(model, measured)


def error_by_scatter(model: AnalyticPush, measured: MeasuredPushes, repeated: Sequence[Array]) -> Array:
    """The arm's part, to second order: how far repeats scatter along and across their way and in depth, and what each
    row's height makes of that.
    """
    count = len(Scatter.quantities)
    curvature, slope, _ = linearise_rows(model.plus(Scatter(np.zeros(count), {})), measured)
    own, asked = curvature[:, -count:, -count:], slope[:, -count:]
    held = _RIDGE * np.trace(own.mean(0)) * np.eye(count)
    beside = np.linalg.solve(own + held, asked[..., None])[..., 0]
    scatter = np.mean([np.cov(beside[rows], rowvar=False) for rows in repeated], axis=0)
    return np.einsum("bij,ij->b", own, scatter)


def error_by_scanner(model: AnalyticPush, measured: MeasuredPushes) -> Array:
    """The scanner's part: what it misses of material as steep that no push touched."""
    change = model.change(measured.scene)
    down, right = np.gradient(measured.scene.before + change, measured.scene.pixel_m, axis=(1, 2))
    steep = np.digitize(np.hypot(down, right), _SLOPES)
    missed = np.square(residual(model, measured))
    untouched = measured.valid & (np.abs(change) * MM < _UNTOUCHED_MM)
    noise = np.zeros(len(_SLOPES) + 1)
    for k in range(len(noise)):
        alike = untouched & (steep == k)
        noise[k] = missed[alike].mean() if alike.sum() >= _FEWEST else noise[max(k - 1, 0)]
    return (np.where(measured.valid, noise[steep], 0) * measured.weight).sum((1, 2)) / measured.valid.sum((1, 2))
