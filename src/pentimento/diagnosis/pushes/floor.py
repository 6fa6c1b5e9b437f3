"""Noise floor of pushes from repeated actions, and the effect of execution and scanner noise on each surface.

The floor is the error of a perfect model (docs/diagnosis.md §7). Repeats measure the noise on the surfaces that they
meet. On other surfaces the same noise has a different effect: an arm that reaches its place within a third of a
millimetre causes a smaller error on flat material than at the wall of an old groove, and a scanner is less accurate on
a wall.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.evaluation import MIN_REPEATED, Floor, repeat_variances, weighted_floor
from pentimento.diagnosis.pushes.jacobian import MM, linearise_rows, residual
from pentimento.diagnosis.pushes.measured import MeasuredPushes
from pentimento.dynamics.pushes.analytic import AnalyticPush
from pentimento.dynamics.pushes.analytic_scene import PushScene
from pentimento.dynamics.pushes.mechanisms.mechanism import Mechanism, Motion, Quantity

Array = NDArray[Any]
_STEP_M = 1e-5
"""Finite-difference step."""
_RIDGE = 1e-6
"""Relative to the mean sensitivity: pushes that hardly depend on the arm's place do not determine it."""
_SLOPES = (0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.5, 2.2)
"""Bin edges of the surface's slope."""
_MIN_PIXELS = 100
"""Bins with fewer pixels take the value of the next flatter bin."""
_UNTOUCHED_MM = 0.02
"""Predicted change below which a pixel counts as untouched."""


def noise_floor(model: AnalyticPush, measured: MeasuredPushes, seed: int) -> Floor | None:
    """Noise floor from repeated actions, weighted like the errors, mm²; None with too few repeats.

    It is computed from residuals, so that predicted differences between repeats (the surface below) are not noise.
    """
    _, spread = _spread_of_repeats(model, measured)
    return weighted_floor(spread, np.ones(len(spread)), seed) if len(spread) >= MIN_REPEATED else None


def _spread_of_repeats(model: AnalyticPush, measured: MeasuredPushes) -> tuple[list[Array], Array]:
    """Rows of each repeated action with aligned windows, and the spread [K] of their residuals, weighted like the
    errors, mm²."""
    groups = [np.flatnonzero(measured.action == action) for action in np.unique(measured.action)]
    window = measured.samples.window_m
    aligned = [g for g in groups if len(g) > 1 and np.ptp(window[g], axis=0).max() < measured.scene.pixel_m / 2]
    residuals = np.sqrt(measured.weight) * residual(model, measured)
    return aligned, repeat_variances(residuals, measured.valid, aligned)


class ExecutionNoise(Mechanism):
    """Pseudo-mechanism: the tool acts beside its command."""

    cause: ClassVar[str] = "scatter"
    site = "command"
    driving_covariate = "nothing"
    quantities = (Quantity("along", "m", 0.0003), Quantity("across", "m", 0.0003), Quantity("lower", "m", 0.0003))

    def motion(self, motion: Motion, scene: PushScene) -> Motion:
        along, across, lower = self.values
        return motion._replace(
            along_m=motion.along_m + along, across_m=motion.across_m + across, lower_m=motion.lower_m + lower
        )


def noise_derivatives(model: AnalyticPush, scene: PushScene) -> Array:
    """Derivatives of a model's change of height by the quantities of ``ExecutionNoise``, mm per mm, float32[3, B, H,
    W]."""
    unchanged = model.change(scene)
    steps = _STEP_M * np.eye(len(ExecutionNoise.quantities))
    return np.stack(
        [(model.plus(ExecutionNoise(step, {})).change(scene) - unchanged) / np.float32(_STEP_M) for step in steps]
    )


def error_of_noise(model: AnalyticPush, measured: MeasuredPushes, repeated: Sequence[Array]) -> Array:
    """Mean squared error [B] of each row that execution noise and scanner noise cause, weighted like the errors, mm².

    Args:
        repeated: rows of each of some repeated actions.
    """
    return error_of_execution_noise(model, measured, repeated) + error_of_scanner_noise(model, measured)


def error_of_execution_noise(model: AnalyticPush, measured: MeasuredPushes, repeated: Sequence[Array]) -> Array:
    """The part of execution noise, to second order: the scatter of repeats along, across and in depth, times the
    sensitivity of each row."""
    count = len(ExecutionNoise.quantities)
    curvature, slope, _ = linearise_rows(model.plus(ExecutionNoise(np.zeros(count), {})), measured)
    curvature, slope = curvature[:, -count:, -count:], slope[:, -count:]
    ridge = _RIDGE * np.trace(curvature.mean(0)) * np.eye(count)
    beside = np.linalg.solve(curvature + ridge, slope[..., None])[..., 0]
    scatter = np.mean([np.cov(beside[rows], rowvar=False) for rows in repeated], axis=0)
    return np.einsum("bij,ij->b", curvature, scatter)


def error_of_scanner_noise(model: AnalyticPush, measured: MeasuredPushes) -> Array:
    """The part of scanner noise: the residual of untouched material of equal slope."""
    change = model.change(measured.scene)
    down, right = np.gradient(measured.scene.before + change, measured.scene.pixel_m, axis=(1, 2))
    steep = np.digitize(np.hypot(down, right), _SLOPES)
    squared = np.square(residual(model, measured))
    untouched = measured.valid & (np.abs(change) * MM < _UNTOUCHED_MM)
    noise = np.zeros(len(_SLOPES) + 1)
    for k in range(len(noise)):
        equally_steep = untouched & (steep == k)
        noise[k] = squared[equally_steep].mean() if equally_steep.sum() >= _MIN_PIXELS else noise[max(k - 1, 0)]
    return (np.where(measured.valid, noise[steep], 0) * measured.weight).sum((1, 2)) / measured.valid.sum((1, 2))
