"""Pushes as the analytic model sees them: heights about the surface at the start, and where each pixel lies.

Nothing is resampled. Instead of turning a scan into the constant pose of 7.3.4, each pixel knows its place in the frame
of its push (origin at the start, ``along`` the travel, ``across`` to its left), so that a model written in that frame
foretells the scan as it was taken.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.dynamics.pushes.measured import PushSamples
from pentimento.dynamics.pushes.resistance import resistance_of

Array = NDArray[Any]

_NEAR_M = 0.003
"""Of the start: where the surface's height is read."""
_INDENTED = 0.1
"""Of a push's deepest lowering: what counts as its footprint."""
_NARROWEST_M = 0.002


@dataclass(frozen=True)
class PushScene:
    """B pushes before they are made, on one pixel size."""

    before: Array
    """float32[B, H, W] metres above the surface at the start of each push."""
    along: Array
    """float32[B, H, W] metres from the start in the direction of travel."""
    across: Array
    """float32[B, H, W] metres to the left of it."""
    action: Array
    """float64[B, 5] x_m, y_m, theta_rad, length_m, depth_m; canvas frame."""
    worked: Array
    """float32[B, H, W] metres: how deep earlier pushes of the same session, since the material was smoothed, went at
    each place, summed; 0 where none did."""
    history_known: bool
    """Whether the rows say when the material was smoothed; ``worked`` is 0 if not."""
    covariates: dict[str, Array]
    """float64[B] each, NaN where unknown."""
    resistance: Array
    """float32[2, B, STATIONS, depths]: how hard the surface pushes back, and what was worked of it (``resistance``)."""
    pixel_m: float
    half_width_m: float
    """Usual half-width of the footprint: the length that profiles and rims are told in."""

    def __len__(self) -> int:
        return len(self.action)

    def pick(self, rows: Array | slice) -> PushScene:
        """The pushes with these indices."""
        return replace(
            self, before=self.before[rows], along=self.along[rows],
            across=self.across[rows], action=self.action[rows],
            worked=self.worked[rows], covariates={name: values[rows] for name, values in self.covariates.items()},
            resistance=self.resistance[:, rows],
        )  # fmt: skip


def push_scene(
    before: Array,
    along: Array,
    across: Array,
    worked: Array,
    action: Array,
    history_known: bool,
    covariates: dict[str, Array],
    pixel_m: float,
    half_width_m: float,
) -> PushScene:
    """The scene with these maps and numbers (see ``PushScene``), and how hard its surfaces push back."""
    resistance = resistance_of(before, along, across, worked, action, pixel_m, half_width_m)
    return PushScene(
        before, along, across, action, worked, history_known, covariates, resistance, pixel_m, half_width_m
    )  # fmt: skip


def scene_of(samples: PushSamples, half_width_m: float | None = None, denoised: Array | None = None) -> PushScene:
    """Measured pushes without what came of them.

    Args:
        denoised: ``before`` [N, H, W] less the scanner's noise; by default as it is.
        half_width_m: of the footprint; by default as ``usual_half_width_m`` reads it off the scans.

    Raises:
        ContractError: there are pinches among them.
    """
    pinches = int((samples.kind != "push").sum())
    if pinches:
        raise ContractError(
            f"{pinches} of {len(samples.kind)} rows are pinches, and the analytic model knows the geometry of pushes "
            "alone: keep the rows whose kind is push."
        )
    along, across = local_places(samples.window_m, samples.before.shape[1:], samples.action, samples.pixels_per_m)
    width = usual_half_width_m(samples) if half_width_m is None else half_width_m
    _at_start(along, across)
    worked, known = _worked(samples, width)
    before = ((samples.before if denoised is None else denoised) - samples.surface_m[:, None, None]).astype(np.float32)
    return push_scene(
        before, along, across, worked, samples.action, known, samples.covariates, 1 / samples.pixels_per_m, width
    )  # fmt: skip


def local_places(window_m: Array, shape: tuple[int, ...], action: Array, pixels_per_m: float) -> tuple[Array, Array]:
    """Where the pixel centres of windows [B, 4] lie in the frames of pushes [B, 5]: along and across, float32[B, H, W].

    Row 0 is the top (y_max); across is positive to the left of the travel.
    """
    height, width = shape
    x = window_m[:, 0, None] + (np.arange(width) + 0.5) / pixels_per_m - action[:, 0, None]
    y = window_m[:, 3, None] - (np.arange(height) + 0.5) / pixels_per_m - action[:, 1, None]
    cos, sin = np.cos(action[:, 2])[:, None, None], np.sin(action[:, 2])[:, None, None]
    along = cos * x[:, None, :] + sin * y[:, :, None]
    across = cos * y[:, :, None] - sin * x[:, None, :]
    return along.astype(np.float32), across.astype(np.float32)


def from_way(scene: PushScene) -> Array:
    """How far places lie from the way of the tool, in half-widths of the footprint, float32[B, H, W]."""
    station = np.clip(scene.along, 0.0, scene.action[:, 3, None, None])
    return (np.hypot(scene.along - station, scene.across) / scene.half_width_m).astype(np.float32)


def surface_at_start(height_m: Array, along: Array, across: Array) -> Array:
    """Height [B] from which the depth of pushes that are not made yet counts (7.3.2): the median of [B, H, W], without
    holes, within 3 mm of each one's start.

    As ``contracts.height_maps.surface_at_m`` reads it for the robot: not smoothed, for on a wall the median jumps.

    Raises:
        ContractError: a push starts outside its window.
    """
    near = _at_start(along, across)
    return np.array([np.median(height[there]) for height, there in zip(height_m, near, strict=True)], dtype=np.float64)


def _at_start(along: Array, across: Array) -> Array:
    """Which places are near the start of each push, bool[B, H, W]."""
    near = np.hypot(along, across) <= _NEAR_M + 1e-9
    if not np.any(near, axis=(1, 2)).all():
        raise ContractError("The start of a push lies outside its window: record scans that show it.")
    return np.asarray(near)


def usual_half_width_m(samples: PushSamples) -> float:
    """Median over pushes of the half-width w of the footprint at the end of travel.

    From its area: a ramp widens as the root of its depth and ends in half a disc, A = 4/3 w L + pi/2 w^2.
    """
    lowered = np.where(samples.known, samples.before - samples.after, 0.0)
    deepest = np.quantile(lowered.reshape(len(lowered), -1), 0.998, axis=1)
    area = (lowered > _INDENTED * deepest[:, None, None]).sum((1, 2)) / samples.pixels_per_m**2
    length = samples.action[:, 3] * 4 / 3
    half = (np.sqrt(np.square(length) + 2 * np.pi * area) - length) / np.pi
    return float(max(np.median(half), _NARROWEST_M))


def swept_m(along: Array, across: Array, length_m: Array, depth_m: Array, half_width_m: float) -> Array:
    """How deep a round tool goes at places [B, H, W] of a flat surface in pushes of these lengths and depths [B]."""
    length, depth = length_m[:, None, None], depth_m[:, None, None]
    station = np.clip(along, 0.0, length)
    ramp = np.where(length > 0, station / np.maximum(length, 1e-9), 1.0)
    away = (np.square(along - station) + np.square(across)) / half_width_m**2
    return np.maximum(depth * (ramp - away), 0.0).astype(np.float32)


def _worked(samples: PushSamples, half_width_m: float) -> tuple[Array, bool]:
    """``PushScene.worked`` and whether it is known."""
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
        along, across = local_places(windows, worked.shape[1:], actions, samples.pixels_per_m)
        worked[row] = swept_m(along, across, actions[:, 3], actions[:, 4], half_width_m).sum(0)
    return worked, True


def smoothed_periods(samples: PushSamples) -> Array | None:
    """int64[B]: rows of one value lie between the same two smoothings of the material; None where that is unknown."""
    known = samples.covariates
    if "reset_id" in known and np.isfinite(known["reset_id"]).all():
        names = [f"{s} {int(r)}" for s, r in zip(samples.session, known["reset_id"], strict=True)]
    elif "pushes_since_reset" in known and np.isfinite(known["pushes_since_reset"]).all():
        turn = np.rint(known["order"] - known["pushes_since_reset"]).astype(int)
        names = [f"{s} {t}" for s, t in zip(samples.session, turn, strict=True)]
    else:
        return None
    return np.asarray(np.unique(names, return_inverse=True)[1])
