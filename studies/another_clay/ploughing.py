"""A tool that ploughs a height field, station by station: what is in its way is laid around it. Millimetres; rows of
arrays run downwards.
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
_BOX = int(26.0 / PIXEL_MM)
"""Pixels about the tool beyond which nothing is laid."""
_FELT = int(4.0 / PIXEL_MM)
"""Pixels about the tool's axis whose hardness it feels."""


@njit(cache=True)
def underside_mm(away_mm: float, ball_mm: float, flank: float, wider: float) -> float:
    """How high above its tip a ball goes over into a cone of slope ``flank``; ``wider``: by what factor it is."""
    away = away_mm / wider
    cosine = 1.0 / math.sqrt(1.0 + flank * flank)
    touches = ball_mm * flank * cosine
    if away <= touches:
        return ball_mm - math.sqrt(ball_mm * ball_mm - away * away)
    return ball_mm * (1.0 - cosine) + flank * (away - touches)


@njit(cache=True)
def plough(
    height: Array,
    worked: Array,
    way: Array,
    tool: tuple[float, float, float],
    laid: tuple[float, float, float],
    heading: tuple[float, float],
    held_up: float,
    lost: float,
    far: float,
) -> float:
    """Change ``height`` [N, N] along a way [n, 4] of x, y, height of the tip and commanded depth; return what comes up
    far around, heights summed over pixels.

    Args:
        worked: how much each place has been pressed before, millimetres.
        tool: radius of the ball, slope of the cone, by what factor it is wider.
        laid: how far from the contact, share by where it is heading, share of that to the sides.
        held_up: share of the depth by which much worked clay holds the tool up.
        lost: share of a push of 6 mm that is compressed.
        far: share of the rest that comes up far around.
    """
    reach_mm, forward, aside = laid
    weight = np.zeros((2 * _BOX + 3, 2 * _BOX + 3))
    sent_far = 0.0
    for station in range(way.shape[0]):
        x, y, tip, depth = way[station]
        row, column = int((SIZE_MM - y) / PIXEL_MM), int(x / PIXEL_MM)
        if held_up != 0.0:
            felt = worked[
                max(row - _FELT, 0) : min(row + _FELT + 1, PIXELS),
                max(column - _FELT, 0) : min(column + _FELT + 1, PIXELS),
            ]
            tip += held_up * depth * (1.0 - math.exp(-felt.mean() / 3.0))
        top, bottom = max(row - _BOX, 0), min(row + _BOX + 1, PIXELS)
        left, right = max(column - _BOX, 0), min(column + _BOX + 1, PIXELS)
        taken, cells = 0.0, 0
        for i in range(top, bottom):
            north = SIZE_MM - (i + 0.5) * PIXEL_MM - y
            for j in range(left, right):
                under = tip + underside_mm(math.hypot((j + 0.5) * PIXEL_MM - x, north), *tool)
                if height[i, j] > under:
                    taken += height[i, j] - under
                    height[i, j] = under
                    cells += 1
        if taken <= 0.0:
            continue
        if lost > 0.0:
            taken *= 1.0 - min(0.95, lost * (0.4 + 0.6 * min(depth, 12.0) / 6.0))
        sent_far += taken * far
        taken *= 1.0 - far
        contact_mm = math.sqrt(cells * PIXEL_MM * PIXEL_MM / math.pi)
        total = 0.0
        for i in range(top, bottom):
            north = SIZE_MM - (i + 0.5) * PIXEL_MM - y
            for j in range(left, right):
                east = (j + 0.5) * PIXEL_MM - x
                away = math.hypot(east, north)
                room = tip + underside_mm(away, *tool) - height[i, j]
                share = 0.0
                if room > 1e-9:
                    ahead = (east * heading[0] + north * heading[1]) / max(away, 0.3)
                    bow, flanks = (0.5 * (1.0 + ahead)) ** 2, math.exp(-(((ahead - 0.15) / 0.45) ** 2))
                    share = 1.0 - forward + forward * ((1.0 - aside) * bow + aside * flanks)
                    share *= math.exp(-((max(away - contact_mm, 0.0) / reach_mm) ** 1.3)) * min(1.0, room / 0.3)
                weight[i - top, j - left] = share
                total += share
        if total > 0.0:
            height[top:bottom, left:right] += taken / total * weight[: bottom - top, : right - left]
    return sent_far


@njit(cache=True)
def slide(height: Array, steepest: float, box: tuple[int, int, int, int], sweeps: int) -> None:
    """Material in a box of pixels (first and past the last row, column) slides to lower neighbours until no slope is
    steeper, or for so many sweeps.
    """
    top, bottom, left, right = box
    for _ in range(sweeps):
        moved = 0.0
        for i in range(top, bottom):
            for j in range(left, right):
                for down, along in ((0, 1), (1, 0), (1, 1), (1, -1)):
                    a, b = i + down, j + along
                    if a >= bottom or b >= right or b < left:
                        continue
                    fall = height[i, j] - height[a, b]
                    over = abs(fall) - steepest * PIXEL_MM * math.sqrt(down * down + along * along)
                    if over > 0.0:
                        part = math.copysign(0.22 * over, fall)
                        height[i, j] -= part
                        height[a, b] += part
                        moved += abs(part)
        if moved < 1e-3:
            return
