"""Displacement of material by a travelling tool, step by step along its path.

At each step the tool removes the material above its underside and deposits it around the contact: more ahead of the
tool than behind it, and almost none in the groove that it has just made. Deposited material that the tool meets again
is moved along, so heaps grow ahead of a tool and are shed at its sides. An old hole takes the material that falls into
it, as far as the tool leaves room there.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pentimento.planning.pushes.analytic.contact import Sweep, above_tip

Array = NDArray[Any]

_PITCH = 0.45
"""Distance between steps, in half-widths of the footprint."""
_MIN_STEPS = 4
_MAX_STEPS = 12
_WIDTHS = 3.0
"""Reach of the Gaussian deposition kernel, in standard deviations."""
_FAR = np.float32(5)
"""Distance in softnesses of the contact edge beyond which there is no contact."""
_GROOVE_M = np.float32(0.0004)
"""Depth of a groove that takes half as much material as level ground."""
_MAX_RADIUS = np.float32(2.6)
"""Radius of the tool in half-widths of the footprint."""
_PROFILE_SAMPLES = 64
"""Samples of the tool's profile."""
_TINY = np.float32(1e-12)
"""Avoids a division by zero on the tool's axis."""
_MIN_WEIGHT = np.float32(0.02)
"""Lower bound of the direction and stand-off factors of the deposit."""


def heaped(
    sweep: Sweep, width_px: float, *, facing: float, flanking: float, log_steep: float, stand_off: float, refill: float
) -> Array:
    """Height of the deposit around the grooves of B pushes, float32[B, H, W] metres; material is conserved.

    Args:
        width_px: standard deviation of the deposition kernel around the contact.
        facing: extra deposit straight ahead of a level travel, relative to the sides.
        flanking: extra deposit at the sides of a level travel, and as much less ahead of it and behind it.
        log_steep: logarithm of the length of a travel over its depth at which its direction has 0.7 of its effect.
        stand_off: reduction of the deposit at the contact edge; 0: none, 2: no deposit at a straight edge.
        refill: deposit in the tool's own groove, relative to level ground; 0: almost none.
    """
    reach = math.ceil(_WIDTHS * width_px)
    kernel = np.exp(-np.square(np.arange(-reach, reach + 1) / width_px) / 2)
    kernel = (kernel / kernel.sum()).astype(np.float32)
    pitch = _PITCH * sweep.fixed[4]
    steps = np.clip(np.ceil(sweep.motion[:, 3] / pitch) + 1, _MIN_STEPS, _MAX_STEPS).astype(np.int64)
    deposit = np.zeros_like(sweep.before)
    shape = np.array([facing, flanking, np.exp(log_steep), stand_off, refill], dtype=np.float32)
    _displace(sweep.single(), kernel, shape, steps, deposit)
    return deposit


@njit(cache=True, error_model="numpy", nogil=True)
def _displace(sweep: Sweep, kernel: Array, shape: Array, steps: Array, deposit: Array) -> None:
    before, along, across, motion, tip_depth, knots, fixed = sweep
    radius, aspect, corners, edge, half_width = fixed
    facing, flanking, steep, stand_off, refill = shape
    one, whole = np.float32(1), np.float32(tip_depth.shape[1] - 1)
    rows, columns = before.shape[1:]
    apart = _MAX_RADIUS * half_width / np.float32(_PROFILE_SAMPLES - 1)
    profile = np.empty(_PROFILE_SAMPLES, np.float32)
    for n in range(_PROFILE_SAMPLES):
        profile[n] = above_tip(apart * np.float32(n), radius, knots)
    ground, contact = np.empty((rows, columns), np.float32), np.empty((rows, columns), np.float32)
    spread, weight = np.empty((rows, columns), np.float32), np.empty((rows, columns), np.float32)
    for b in range(before.shape[0]):
        shift, aside, _, length, wider, _ = motion[b]
        narrower = np.float32(math.exp(-wider))
        ground[:] = before[b]
        highest = before[b].max() + tip_depth[b].max() + _FAR * edge
        n = 1
        while n < _PROFILE_SAMPLES - 1 and profile[n] < highest:
            n += 1
        side_m = apart * np.float32(n) / (narrower * min(aspect, one) * math.sqrt(one - max(corners, np.float32(0))))
        lowest = max(tip_depth[b, tip_depth.shape[1] - 1], np.float32(1e-4))
        level = length / np.float32(math.hypot(length, steep * lowest))
        laid = facing * level, flanking * level, stand_off, refill
        right_m, left_m = along[b, 0, 1] - along[b, 0, 0], across[b, 0, 1] - across[b, 0, 0]
        pixel2 = right_m * right_m + left_m * left_m
        side = int(side_m / math.sqrt(pixel2)) + 1
        for step in range(steps[b]):
            part = np.float32(step) / np.float32(steps[b] - 1)
            station = min(int(part * whole), tip_depth.shape[1] - 2)
            depth = tip_depth[b, station] + (part * whole - station) * (
                tip_depth[b, station + 1] - tip_depth[b, station]
            )
            u0 = shift + part * length
            # Rows run down: across the columns' direction.
            u, v = u0 - along[b, 0, 0], aside - across[b, 0, 0]
            column, row = int((u * right_m + v * left_m) / pixel2), int((u * left_m - v * right_m) / pixel2)
            box = (
                max(row - side, 0), min(row + side + 1, rows - 1),
                max(column - side, 0), min(column + side + 1, columns - 1),
            )  # fmt: skip
            taken, box = _take(
                (u0, aside, depth, narrower, aspect, corners, edge, apart), box, profile, along[b], across[b], ground,
                contact, deposit[b],
            )  # fmt: skip
            if taken > 0:
                _deposit(
                    taken, (u0, aside, half_width), laid, box, kernel, before[b], along[b], across[b],
                    ground, contact, spread, weight, deposit[b],
                )  # fmt: skip


@njit(cache=True, error_model="numpy", nogil=True)
def _take(
    numbers: tuple[float, float, float, float, float, float, float, float],
    box: tuple[int, int, int, int],
    profile: Array,
    along: Array,
    across: Array,
    ground: Array,
    contact: Array,
    deposit: Array,
) -> tuple[np.float32, tuple[int, int, int, int]]:
    """Remove the material above the tool within a box of pixels (first and last row, column), and find the contact.

    Returns the removed height, summed over pixels, and the box around the contact.
    """
    u0, v0, depth, narrower, aspect, corners, edge, apart = numbers
    one, zero, last_radius = np.float32(1), np.float32(0), np.float32(len(profile) - 1)
    taken = zero
    touched = len(ground), -1, len(ground[0]), -1
    for i in range(box[0], box[1] + 1):
        for j in range(box[2], box[3] + 1):
            contact[i, j] = zero
            u, v = (along[i, j] - u0) * aspect, across[i, j] - v0
            squared = u * u + v * v
            squared -= corners * 4 * (u * v) * (u * v) / (squared + _TINY)
            away = np.float32(math.sqrt(squared)) * narrower / apart
            if away >= last_radius:
                continue
            n = int(away)
            tool = profile[n] + (away - n) * (profile[n + 1] - profile[n]) - depth
            over = ground[i, j] + deposit[i, j] - tool
            ratio = over / edge
            if ratio < -_FAR:
                continue
            decayed = np.float32(math.exp(-abs(ratio)))
            contact[i, j] = (one if ratio > zero else decayed) / (one + decayed)
            touched = min(touched[0], i), max(touched[1], i), min(touched[2], j), max(touched[3], j)
            if over > zero:
                taken += over
                again = min(over, deposit[i, j])
                deposit[i, j] -= again
                ground[i, j] -= over - again
    return taken, touched


@njit(cache=True, error_model="numpy", nogil=True, fastmath={"reassoc", "contract", "arcp"})
def _deposit(
    taken: np.float32,
    tool: tuple[float, float, float],
    laid: tuple[float, float, float, float],
    box: tuple[int, int, int, int],
    kernel: Array,
    before: Array,
    along: Array,
    across: Array,
    ground: Array,
    contact: Array,
    spread: Array,
    weight: Array,
    deposit: Array,
) -> None:
    """Deposit the removed material around the contact, which lies within the box of pixels (first and last row,
    column)."""
    (u0, v0, half_width), (facing, flanking, stand_off, refill) = tool, laid
    one, zero, per_groove = np.float32(1), np.float32(0), 1 / _GROOVE_M
    top, bottom, first, last = box
    reach = len(kernel) // 2
    high, low = max(top - reach, 0), min(bottom + reach, deposit.shape[0] - 1)
    left, right = max(first - reach, 0), min(last + reach, deposit.shape[1] - 1)
    width = right - left + 1  # loops from 0 up are compiled to vectors
    for i in range(top, bottom + 1):
        spread[i, left : right + 1] = zero
        for t in range(first, last + 1):
            here = contact[i, t]
            start, end = max(t - reach, left), min(t + reach, right) + 1
            into, of = spread[i, start:end], kernel[start - t + reach :]
            for j in range(end - start):
                into[j] += here * of[j]
    total = zero
    for i in range(high, low + 1):
        row = weight[i, left : right + 1]
        row[:] = zero
        for t in range(max(i - reach, top), min(i + reach, bottom) + 1):
            share, of = kernel[t - i + reach], spread[t, left : right + 1]
            for j in range(width):
                row[j] += share * of[j]
        u, v = along[i, left : right + 1], across[i, left : right + 1]
        first_m, now_m = before[i, left : right + 1], ground[i, left : right + 1]
        for j in range(width):
            ahead_m, aside_m, lowered = u[j] - u0, v[j] - v0, (first_m[j] - now_m[j]) * per_groove
            away_m = np.float32(math.sqrt(ahead_m * ahead_m + aside_m * aside_m)) + half_width / 2
            row[j] *= max(one - stand_off * row[j], _MIN_WEIGHT) * (refill + (one - refill) / (one + lowered * lowered))
            ahead, beside = ahead_m / away_m, aside_m / away_m
            row[j] *= max(one + facing * ahead + flanking * (beside * beside - ahead * ahead), _MIN_WEIGHT)
        if top <= i <= bottom:
            for j in range(first, last + 1):
                weight[i, j] *= one - contact[i, j]
        for j in range(width):
            total += row[j]
    if total > zero:
        share = taken / total
        for i in range(high, low + 1):
            row, onto = weight[i, left : right + 1], deposit[i, left : right + 1]
            for j in range(width):
                onto[j] += share * row[j]
