"""How hard a surface pushes back at a round tool, by place of its way and by depth.

What stands in the tool's way bears it, as soil bears a plate: the pressure grows with the sinkage z as z^n (Bekker
1956; n is 0.5 for what yields at once, and 1 for what packs). Where an old groove takes the tool it bears little, on a
wall much: arms and slabs that give way let the tool go less deep there. Of material that was worked before, the share
of it that counts is told apart, for it may be harder.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[Any]

STATIONS = 9
"""Places of the way, from its start to its end."""
_DEPTHS = 12
_DEEPEST = 1.5
"""Of the commanded depth: beyond, the force is that at this depth."""
_MIN_DEEPEST_M = 0.004
_WIDEST = 1.15
"""Of the footprint's half-width: no tool reaches further."""
_UNIT_M = 0.005
"""Depth on level material at which the force counts 1."""
_WORKED_M = np.float32(0.005)
"""Earlier work at which half of what material can gain in hardness is reached."""


def resistance_of(
    before: Array, along: Array, across: Array, worked: Array, action: Array, pixel_m: float, half_width_m: float
) -> Array:
    """The force on a ball whose radius is the footprint's half-width, float32[2, B, STATIONS, depths]: at each place of
    the way, for depths from 0 below the surface at the start to ``deepest_m``. 1 is what a level surface does to one
    that is pressed 5 mm straight down. First of everything, then of what was worked before, w / (w + 5 mm) of it after
    work w.

    Args:
        before, along, across, worked: float32[B, H, W] metres, as of a ``PushScene``.
        action: float64[B, 5].
    """
    found = np.zeros((2, len(before), STATIONS, _DEPTHS), dtype=np.float32)
    deepest = deepest_m(action[:, 4]).astype(np.float32)
    _forces(before, along, across, worked, action[:, 3].astype(np.float32), deepest, np.float32(half_width_m), found)
    # The integral of sqrt(z - r^2 / 2 w) over where it is above 0.
    unit = 4 / 3 * math.pi * half_width_m * _UNIT_M**1.5
    return found * np.float32(pixel_m**2 / unit)


def deepest_m(depth_m: Array) -> Array:
    """Down to where the force is told, of pushes of these depths [B]."""
    return np.maximum(_DEEPEST * depth_m, _MIN_DEEPEST_M)


def yielded(resistance: Array, deepest: Array, wanted_m: Array, give_m: float) -> Array:
    """Depths float64[B, STATIONS] that a tool reaches which gives way by ``give_m`` for a force of 1, where
    wanted - depth = give * force(depth).

    Args:
        resistance: [B, STATIONS, depths], forces as by ``resistance_of``.
        deepest: ``deepest_m`` [B] of these pushes.
        wanted_m: [B, STATIONS] depths of a tool that does not give way.
    """
    depth = wanted_m.astype(np.float64)
    if give_m:
        _yield(resistance, deepest, depth, give_m)
    return depth


@njit(cache=True, error_model="numpy", nogil=True)
def _yield(resistance: Array, deepest: Array, depth: Array, give_m: float) -> None:
    last = resistance.shape[2] - 1
    for b in range(depth.shape[0]):
        for k in range(depth.shape[1]):
            wanted = depth[b, k]
            # Within a piece both sides are straight: go up from the deepest piece that may hold the answer.
            piece = last - 1
            step = deepest[b] / last
            while piece > 0 and wanted - piece * step < give_m * resistance[b, k, piece]:
                piece -= 1
            start, force = piece * step, resistance[b, k, piece]
            rate = (resistance[b, k, piece + 1] - force) / step
            found = start + (wanted - start - give_m * force) / (1 + give_m * rate)
            if found > deepest[b]:
                found = wanted - give_m * resistance[b, k, last]
            elif found < 0:
                found = wanted - give_m * resistance[b, k, 0]
            depth[b, k] = found


@njit(cache=True, error_model="numpy", nogil=True)
def _forces(
    before: Array,
    along: Array,
    across: Array,
    worked: Array,
    length: Array,
    deepest: Array,
    half: Array,
    found: Array,
) -> None:
    widest = np.float32(_WIDEST) * half
    stations, depths = found.shape[2], found.shape[3]
    bend = np.float32(0.5) / half
    for b in range(before.shape[0]):
        for i in range(before.shape[1]):
            for j in range(before.shape[2]):
                u, v = along[b, i, j], across[b, i, j]
                if abs(v) > widest or u < -widest or u > length[b] + widest:
                    continue
                hard = worked[b, i, j] / (worked[b, i, j] + _WORKED_M)
                for k in range(stations):
                    away = u - length[b] * np.float32(k) / np.float32(stations - 1)
                    squared = away * away + v * v
                    if squared > widest * widest:
                        continue
                    above = before[b, i, j] - squared * bend
                    for d in range(depths):
                        depth = deepest[b] * np.float32(d) / np.float32(depths - 1)
                        sunk = above + depth
                        # What lies further behind than this was lowest pressed before; there the tool hangs free.
                        if sunk > 0 and -away * length[b] * np.float32(k) <= half * depth * np.float32(stations - 1):
                            borne = np.float32(math.sqrt(sunk))
                            found[0, b, k, d] += borne
                            found[1, b, k, d] += hard * borne
