"""The analytic model's scene of measured pushes: places, history and the typical footprint, from rows of a table."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.dynamics.pushes.measured import PushSamples
from pentimento.planning.pushes.analytic.scene import PushScene, local_places, near_start, push_scene, swept_m

Array = NDArray[Any]
_FOOTPRINT_FRACTION = 0.1
"""Pixels lowered by more than this fraction of the deepest lowering belong to the footprint."""
_MIN_HALF_WIDTH_M = 0.002
"""Lower bound of the footprint's half-width; noise alone would give less."""


def scene_of(samples: PushSamples, half_width_m: float | None = None, denoised: Array | None = None) -> PushScene:
    """Scene of measured pushes, without their outcome.

    Args:
        half_width_m: half-width of the footprint; by default estimated from the scans (``usual_half_width_m``).
        denoised: ``before`` [N, H, W] without scanner noise; by default ``before`` itself.

    Raises:
        ContractError: there are pinches among them.
    """
    pinches = int((samples.kind != "push").sum())
    if pinches:
        raise ContractError(
            f"{pinches} of {len(samples.kind)} rows are pinches, and the analytic model knows the geometry of pushes "
            "alone: keep the rows whose kind is push."
        )
    along, across = local_places(
        samples.window_m, samples.before.shape[1:], action=samples.action, pixels_per_m=samples.pixels_per_m
    )
    width = usual_half_width_m(samples) if half_width_m is None else half_width_m
    near_start(along, across)
    worked, known = _worked(samples, width)
    before = ((samples.before if denoised is None else denoised) - samples.surface_m[:, None, None]).astype(np.float32)
    return push_scene(
        before, along, across, worked=worked, action=samples.action, history_known=known,
        covariates=samples.covariates, pixel_m=1 / samples.pixels_per_m, half_width_m=width,
    )  # fmt: skip


def usual_half_width_m(samples: PushSamples) -> float:
    """Median over pushes of the half-width w of the footprint at the end of travel.

    It follows from the footprint's area: a ramp widens as the root of its depth and ends in half a disc, A = 4/3 w L +
    pi/2 w^2.
    """
    lowered = np.where(samples.known, samples.before - samples.after, 0.0)
    deepest = np.quantile(lowered.reshape(len(lowered), -1), 0.998, axis=1)
    area = (lowered > _FOOTPRINT_FRACTION * deepest[:, None, None]).sum((1, 2)) / samples.pixels_per_m**2
    length = samples.action[:, 3] * 4 / 3
    half = (np.sqrt(np.square(length) + 2 * np.pi * area) - length) / np.pi
    return float(max(np.median(half), _MIN_HALF_WIDTH_M))


def _worked(samples: PushSamples, half_width_m: float) -> tuple[Array, bool]:
    """``PushScene.worked``, and whether it is known."""
    worked = np.zeros(samples.before.shape, dtype=np.float32)
    period = smoothed_periods(samples)
    if period is None:
        return worked, False
    order = samples.covariates["order"]
    for row in range(len(order)):
        earlier = np.flatnonzero((period == period[row]) & (order < order[row]))
        if not len(earlier):
            continue
        actions = samples.action[earlier]
        windows = np.repeat(samples.window_m[row : row + 1], len(earlier), axis=0)
        along, across = local_places(windows, worked.shape[1:], action=actions, pixels_per_m=samples.pixels_per_m)
        worked[row] = swept_m(
            along, across, length_m=actions[:, 3], depth_m=actions[:, 4], half_width_m=half_width_m
        ).sum(0)
    return worked, True


def smoothed_periods(samples: PushSamples) -> Array | None:
    """int64[B]: rows with equal values lie between the same two smoothings of the material; None if that is unknown."""
    known = samples.covariates
    if "reset_id" in known and np.isfinite(known["reset_id"]).all():
        names = [f"{s} {int(r)}" for s, r in zip(samples.session, known["reset_id"], strict=True)]
    elif "pushes_since_reset" in known and np.isfinite(known["pushes_since_reset"]).all():
        smoothed_at = np.rint(known["order"] - known["pushes_since_reset"]).astype(int)
        names = [f"{s} {t}" for s, t in zip(samples.session, smoothed_at, strict=True)]
    else:
        return None
    return np.asarray(np.unique(names, return_inverse=True)[1])
