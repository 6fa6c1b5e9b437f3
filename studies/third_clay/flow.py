"""A height field that yields and flows away from under a tool. Millimetres; rows of arrays run downwards.

Material flows between neighbouring cells as a Bingham fluid: in proportion to the difference of their heads, as far as
it exceeds a yield head (Bingham 1916). The head of a cell is its height, plus a multiple of its overlap with the tool.
The tool moves on before the flow ends, so a part of the overlap stays.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[Any]

PIXELS, SIZE_MM = 256, 200.0
PIXEL_MM = SIZE_MM / PIXELS
_REACH = int(24.0 / PIXEL_MM)
"""Pixels about the tool within which material flows."""
_SWEEPS = 100
"""Steps of the flow at each station."""
_RATE = 0.02
"""Share of an excess of head that flows in one step."""
_PRESSURE = 9.0
"""Head of one millimetre of overlap."""
_YIELD_HEAD_MM = 0.3
"""Difference of heads of neighbouring cells up to which nothing flows."""
_WORK_MM = 4.0
"""Earlier lowering at which two thirds of the possible hardening is reached."""
_TOOL_MM = 6.5
"""Radius of the tool at ``_TOOL_MM / 2`` above its tip."""


@njit(cache=True)
def underside_mm(along: float, across: float) -> float:
    """Height of a blunt tool above its tip, flat in the middle and half as wide again across its travel."""
    square = (along / _TOOL_MM) ** 2 + (across / (1.5 * _TOOL_MM)) ** 2
    return float(0.5 * _TOOL_MM * square**1.5)


@njit(cache=True)
def press(height: Array, worked: Array, way: Array, heading_rad: float, hardening: float) -> None:
    """Change ``height`` [N, N] by a tool on its way [n, 3] of x, y and height of the tip.

    Args:
        height: millimetres.
        worked: earlier lowering of each place, millimetres, [N, N].
        way: millimetres.
        heading_rad: direction of the travel.
        hardening: how much slower fully worked material flows, as a logarithm.
    """
    side = 2 * _REACH + 1
    head, under = np.zeros((side, side)), np.zeros((side, side))
    rate = _RATE * np.exp(-hardening * (1.0 - np.exp(-worked / _WORK_MM)))
    ahead, left = math.cos(heading_rad), math.sin(heading_rad)
    for x, y, tip in way:
        row, column = int((SIZE_MM - y) / PIXEL_MM) - _REACH, int(x / PIXEL_MM) - _REACH
        for i in range(side):
            north = SIZE_MM - (row + i + 0.5) * PIXEL_MM - y
            for j in range(side):
                east = (column + j + 0.5) * PIXEL_MM - x
                under[i, j] = tip + underside_mm(east * ahead + north * left, north * ahead - east * left)
        part, slower = height[row : row + side, column : column + side], rate[row : row + side, column : column + side]
        for _ in range(_SWEEPS):
            for i in range(side):
                for j in range(side):
                    head[i, j] = part[i, j] + _PRESSURE * max(part[i, j] - under[i, j], 0.0)
            for i in range(side - 1):
                for j in range(side - 1):
                    for a, b in ((i + 1, j), (i, j + 1)):
                        fall = head[i, j] - head[a, b]
                        if abs(fall) > _YIELD_HEAD_MM:
                            flow = slower[i, j] * (fall - math.copysign(_YIELD_HEAD_MM, fall))
                            part[i, j] -= flow
                            part[a, b] += flow
