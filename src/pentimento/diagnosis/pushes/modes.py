"""Residual modes of pushes, and the covariates that they depend on when no cause explains it (docs/diagnosis.md §9).

A mode is a way in which the whole change of a push can differ: depth, width, shift along and across, rims, smoothing,
volume.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.pushes.jacobian import KeptColumns, linearise_rows
from pentimento.diagnosis.pushes.measured import MeasuredPushes
from pentimento.diagnosis.residual_structure import ModeScores
from pentimento.planning.pushes.analytic.mechanisms.mechanism import (
    Contact,
    Mechanism,
    Motion,
    Quantity,
    Settled,
    spread,
)
from pentimento.planning.pushes.analytic.model import AnalyticPush
from pentimento.planning.pushes.analytic.scene import PushScene

Array = NDArray[Any]

_SMOOTHED = 0.4
"""Width of the smoothing kernel, in half-widths of the footprint."""
_SWOLLEN = 1.5
"""Width of the added volume, in half-widths of the footprint."""


class AllModes(Mechanism):
    """Pseudo-mechanism with the amount of each mode, equal for all pushes."""

    cause: ClassVar[str] = "modes"
    site = "command"
    driving_covariate = "any"
    quantities = (
        Quantity("depth", "1", 0.1),
        Quantity("width", "1", 0.1),
        Quantity("along", "m", 0.0005),
        Quantity("across", "m", 0.0005),
        Quantity("rims", "1", 0.2),
        Quantity("smoothing", "1", 0.2),
        Quantity("volume", "1", 0.1),
    )

    def motion(self, motion: Motion, scene: PushScene) -> Motion:
        depth, width, along, across = self.values[:4]
        return motion._replace(
            along_m=motion.along_m + along, across_m=motion.across_m + across, log_depth=motion.log_depth + depth,
            log_width=motion.log_width + width,
        )  # fmt: skip

    def settled(self, settled: Settled, contact: Contact, scene: PushScene) -> Settled:
        rims, smoothing, volume = self.values[4:].astype(np.float32)
        half_px = scene.half_width_m / scene.pixel_m
        change = settled.lift_m + settled.rims_m - settled.indentation_m
        lift = settled.lift_m + smoothing * (spread(change, _SMOOTHED * half_px) - change)
        lift = lift - volume * spread(settled.indentation_m, _SWOLLEN * half_px)
        return settled._replace(rims_m=settled.rims_m * (1 + rims), lift_m=lift)


MODES = tuple(quantity.name for quantity in AllModes.quantities)


def mode_scores(model: AnalyticPush, measured: MeasuredPushes, kept: KeptColumns | None = None) -> ModeScores:
    """Amounts of the modes in the residuals of a model; ``kept`` as for ``linearise_rows``."""
    curvature, slope, error = linearise_rows(model.plus(AllModes(np.zeros(len(MODES)), {})), measured, kept)
    energy = np.einsum("bmm->bm", curvature[:, -len(MODES) :, -len(MODES) :])
    return ModeScores(slope[:, -len(MODES) :] / np.maximum(energy, 1e-12), energy, float(error.mean()))


def varying_covariates(measured: MeasuredPushes) -> dict[str, Array]:
    """Covariates that vary and are known for every push: recorded, or derived from its command and its surface."""
    recorded = {n: v for n, v in measured.covariates.items() if np.isfinite(v).all() and np.ptp(v) > 1e-9}
    return recorded | command_covariates(measured.scene)


def command_covariates(scene: PushScene) -> dict[str, Array]:
    """Varying covariates of each push that follow from its command and its surface, float64[B] each."""
    x, y, heading, length, depth = scene.action.T
    under = (np.square(scene.across) + np.square(np.minimum(scene.along, 0))) < scene.half_width_m**2
    under &= scene.along < length[:, None, None] + scene.half_width_m
    count = np.maximum(under.sum((1, 2)), 1)
    down, right = np.gradient(scene.before, scene.pixel_m, axis=(1, 2))
    steep = (np.hypot(down, right) * under).sum((1, 2)) / count
    known = {
        "pushed_depth_m": depth, "pushed_length_m": length, "heading_cos": np.cos(heading),
        "heading_sin": np.sin(heading), "start_x_m": x, "start_y_m": y, "slope_below": steep.astype(np.float64),
        "height_below_m": (scene.before * under).sum((1, 2)).astype(np.float64) / count,
    }  # fmt: skip
    if scene.history_known:
        known["worked_below_m"] = (scene.worked * under).sum((1, 2)).astype(np.float64) / count
    return {name: values for name, values in known.items() if np.ptp(values) > 1e-9}
