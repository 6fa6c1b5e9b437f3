"""Noise floor of pushes from repeated actions (docs/diagnosis.md §7), and the effect of execution noise."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.evaluation import Floor, floor_of_repeats
from pentimento.diagnosis.pushes.jacobian import residual
from pentimento.diagnosis.pushes.measured import MeasuredPushes
from pentimento.planning.pushes.analytic.mechanisms.mechanism import Mechanism, Motion, Quantity
from pentimento.planning.pushes.analytic.model import AnalyticPush
from pentimento.planning.pushes.analytic.scene import PushScene

Array = NDArray[Any]
_STEP_M = 1e-5
"""Finite-difference step."""


def noise_floor(model: AnalyticPush, measured: MeasuredPushes, seed: int) -> Floor | None:
    """Noise floor from repeated actions with aligned windows, weighted like the errors, mm²; None with too few repeats.

    It is computed from residuals, so that predicted differences between repeats (the surface below) are not noise.
    """
    groups = [np.flatnonzero(measured.action == action) for action in np.unique(measured.action)]
    window = measured.samples.window_m
    aligned = [g for g in groups if len(g) > 1 and np.ptp(window[g], axis=0).max() < measured.scene.pixel_m / 2]
    residuals = np.sqrt(measured.weight) * residual(model, measured)
    return floor_of_repeats(residuals, measured.valid, aligned, seed)


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
