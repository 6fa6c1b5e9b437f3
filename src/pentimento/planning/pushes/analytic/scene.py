"""Pushes as the analytic model sees them: heights relative to the surface at the start, and each pixel's place.

Nothing is resampled. Instead of turning a scan into the constant pose of 7.3.4, each pixel has its place in the frame
of its push (origin at the start, ``along`` the travel, ``across`` to its left). A model written in that frame predicts
the scan as it was taken.

The scene also holds the resistance of the surface to a round tool, by station of the path and by depth. Material in the
tool's way bears it as soil bears a plate: the pressure grows with the sinkage z as z^n (Bekker 1956; n is 0.5 for
material that yields at once, and 1 for material that packs). An old groove bears little, a wall bears much, so a
compliant arm or slab goes less deep at a wall. The share of previously worked material is kept apart, because it may be
harder.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.contracts.tables import row_list

Array = NDArray[Any]
_NEAR_M = 0.003
"""Radius around the start within which the surface height is read; as in ``contracts.height_maps.surface_at_m``."""
STATIONS = 9
"""Stations of the path, from its start to its end."""
_DEPTHS = 12
"""Depths at which the force is tabulated."""
_MAX_DEPTH = 1.5
"""Deepest tabulated depth, as a multiple of the commanded depth; beyond it the force is constant."""
_MIN_DEEPEST_M = 0.004
"""Lower bound of the deepest tabulated depth."""
_MAX_RADIUS = 1.15
"""Radius of the tool in half-widths of the footprint."""
_UNIT_M = 0.005
"""Depth on level material at which the force is 1."""
_WORKED_M = np.float32(0.005)
"""Earlier work (summed depth) at which half of the possible hardening is reached."""


@dataclass(frozen=True)
class PushScene:
    """B pushes before they are executed, on one pixel size."""

    before: Array
    """float32[B, H, W] metres above the surface at the start of each push."""
    along: Array
    """float32[B, H, W] metres from the start in the direction of travel."""
    across: Array
    """float32[B, H, W] metres to the left of it."""
    action: Array
    """float64[B, 5] x_m, y_m, theta_rad, length_m, depth_m; canvas frame."""
    worked: Array
    """float32[B, H, W] metres: summed depth of earlier pushes at each place, in the same session and since the material
    was smoothed."""
    history_known: bool
    """Whether the rows record when the material was smoothed; otherwise ``worked`` is 0."""
    covariates: dict[str, Array]
    """float64[B] each, NaN where unknown."""
    resistance: Array
    """float32[2, B, STATIONS, depths]: force of the surface, and the part of it from worked material
    (``resistance_of``)."""
    pixel_m: float
    half_width_m: float
    """Typical half-width of the footprint: the unit of length of profiles and rims."""

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
    *,
    worked: Array,
    action: Array,
    history_known: bool,
    covariates: dict[str, Array],
    pixel_m: float,
    half_width_m: float,
) -> PushScene:
    """A scene with these maps and values (see ``PushScene``) and the resistance of its surfaces."""
    resistance = resistance_of(
        before, along, across, worked=worked, action=action, pixel_m=pixel_m, half_width_m=half_width_m
    )
    return PushScene(
        before, along, across, action, worked, history_known, covariates, resistance, pixel_m, half_width_m
    )  # fmt: skip


def local_places(window_m: Array, shape: tuple[int, ...], *, action: Array, pixels_per_m: float) -> tuple[Array, Array]:
    """Places of the pixel centres of windows [B, 4] in the frames of pushes [B, 5]: along and across, float32[B, H, W].

    Row 0 is the top (y_max); across is positive to the left of the travel.
    """
    height, width = shape
    x = window_m[:, 0, None] + (np.arange(width) + 0.5) / pixels_per_m - action[:, 0, None]
    y = window_m[:, 3, None] - (np.arange(height) + 0.5) / pixels_per_m - action[:, 1, None]
    cos, sin = np.cos(action[:, 2])[:, None, None], np.sin(action[:, 2])[:, None, None]
    along = cos * x[:, None, :] + sin * y[:, :, None]
    across = cos * y[:, :, None] - sin * x[:, None, :]
    return along.astype(np.float32), across.astype(np.float32)


def distance_from_path(scene: PushScene) -> Array:
    """Distance from the tool's path, in half-widths of the footprint, float32[B, H, W]."""
    station = np.clip(scene.along, 0.0, scene.action[:, 3, None, None])
    return (np.hypot(scene.along - station, scene.across) / scene.half_width_m).astype(np.float32)


def surface_at_start(height_m: Array, along: Array, across: Array) -> Array:
    """Height [B] from which the depth of planned pushes counts (7.3.2): the median of maps [B, H, W] without holes,
    within 3 mm of each start.

    It matches ``contracts.height_maps.surface_at_m``, which the robot uses. It is not smoothed: on a wall the median
    jumps.

    Raises:
        ContractError: a push starts outside its window.
    """
    near = near_start(along, across)
    return np.array([np.median(height[there]) for height, there in zip(height_m, near, strict=True)], dtype=np.float64)


def near_start(along: Array, across: Array) -> Array:
    """Mask of the places near each push's start, bool[B, H, W]: within 3 mm, or three quarters of a larger pixel."""
    pixel_m = np.hypot(along[..., :1, 1:2] - along[..., :1, :1], across[..., :1, 1:2] - across[..., :1, :1])
    near_m = np.maximum(_NEAR_M, 0.75 * pixel_m) if pixel_m.size else _NEAR_M
    near = np.hypot(along, across) <= near_m + 1e-9
    outside = np.flatnonzero(~np.any(near, axis=(1, 2)))
    if len(outside):
        raise ContractError(
            f"The start of a push lies outside its window (of the pushes that are used, {row_list(outside.tolist())}): "
            "record scans that show it."
        )
    return np.asarray(near)


def swept_m(along: Array, across: Array, *, length_m: Array, depth_m: Array, half_width_m: float) -> Array:
    """Depth of a round tool at places [B, H, W] of a flat surface, for pushes of these lengths and depths [B]."""
    length, depth = length_m[:, None, None], depth_m[:, None, None]
    station = np.clip(along, 0.0, length)
    ramp = np.where(length > 0, station / np.maximum(length, 1e-9), 1.0)
    distance = (np.square(along - station) + np.square(across)) / half_width_m**2
    return np.maximum(depth * (ramp - distance), 0.0).astype(np.float32)


def resistance_of(
    before: Array, along: Array, across: Array, *, worked: Array, action: Array, pixel_m: float, half_width_m: float
) -> Array:
    """Force on a ball whose radius is the footprint's half-width, float32[2, B, STATIONS, depths].

    It is given at each station of the path, for depths from 0 below the surface at the start to ``deepest_m``. The unit
    is the force of a level surface on a ball that is pressed 5 mm straight down. The first entry is the force of all
    material, the second that of worked material, which counts w / (w + 5 mm) after work w.

    Args:
        before, along, across, worked: float32[B, H, W] metres, as in ``PushScene``.
        action: float64[B, 5].
    """
    force = np.zeros((2, len(before), STATIONS, _DEPTHS), dtype=np.float32)
    deepest = deepest_m(action[:, 4]).astype(np.float32)
    _forces(before, along, across, worked, action[:, 3].astype(np.float32), deepest, np.float32(half_width_m), force)
    # The integral of sqrt(z - r^2 / 2 w) over the disc where it is positive.
    unit = 4 / 3 * math.pi * half_width_m * _UNIT_M**1.5
    return force * np.float32(pixel_m**2 / unit)


def deepest_m(depth_m: Array) -> Array:
    """Deepest tabulated depth of pushes with these commanded depths [B]."""
    return np.maximum(_MAX_DEPTH * depth_m, _MIN_DEEPEST_M)


def yielded(resistance: Array, deepest: Array, target_m: Array, give_m: float) -> Array:
    """Depths float64[B, STATIONS] of a tool with compliance ``give_m``: the solution of target - depth = give *
    force(depth).

    Args:
        resistance: [B, STATIONS, depths], forces as from ``resistance_of``.
        deepest: ``deepest_m`` [B] of these pushes.
        target_m: [B, STATIONS] depths of a rigid tool.
    """
    depth = target_m.astype(np.float64)
    if give_m:
        _yield(resistance, deepest, depth, give_m)
    return depth


@njit(cache=True, error_model="numpy", nogil=True)
def _yield(resistance: Array, deepest: Array, depth: Array, give_m: float) -> None:
    last = resistance.shape[2] - 1
    for b in range(depth.shape[0]):
        for k in range(depth.shape[1]):
            target = depth[b, k]
            # Both sides are linear within a segment: search upwards from the deepest segment for the solution.
            piece = last - 1
            step = deepest[b] / last
            while piece > 0 and target - piece * step < give_m * resistance[b, k, piece]:
                piece -= 1
            start, force = piece * step, resistance[b, k, piece]
            rate = (resistance[b, k, piece + 1] - force) / step
            solution = start + (target - start - give_m * force) / (1 + give_m * rate)
            if solution > deepest[b]:
                solution = target - give_m * resistance[b, k, last]
            elif solution < 0:
                solution = target - give_m * resistance[b, k, 0]
            depth[b, k] = solution


@njit(cache=True, error_model="numpy", nogil=True)
def _forces(
    before: Array, along: Array, across: Array, worked: Array, length: Array, deepest: Array, half: Array, force: Array
) -> None:
    widest = np.float32(_MAX_RADIUS) * half
    stations, depths = force.shape[2], force.shape[3]
    bend = np.float32(0.5) / half
    for b in range(before.shape[0]):
        for i in range(before.shape[1]):
            for j in range(before.shape[2]):
                u, v = along[b, i, j], across[b, i, j]
                if abs(v) > widest or u < -widest or u > length[b] + widest:
                    continue
                hard = worked[b, i, j] / (worked[b, i, j] + _WORKED_M)
                for k in range(stations):
                    ahead = u - length[b] * np.float32(k) / np.float32(stations - 1)
                    squared = ahead * ahead + v * v
                    if squared > widest * widest:
                        continue
                    above = before[b, i, j] - squared * bend
                    for d in range(depths):
                        depth = deepest[b] * np.float32(d) / np.float32(depths - 1)
                        sunk = above + depth
                        # Places further behind were pressed at an earlier station; the tool is clear of them now.
                        if sunk > 0 and -ahead * length[b] * np.float32(k) <= half * depth * np.float32(stations - 1):
                            borne = np.float32(math.sqrt(sunk))
                            force[0, b, k, d] += borne
                            force[1, b, k, d] += hard * borne
