"""The shape of a tool's mark beyond a symmetric profile: streaks, a paler side, ragged ends. Part of the base.

Bristles leave what no profile of a few numbers describes, but it is the same in every stroke. Tables hold it: over the
place across the stroke and press along its body, over the place in two dimensions at its ends. They depend on nothing
that a cause depends on (no speed, time, load, heading, place on the canvas; both ends share a table, for a lag shows at
one), so that they can be estimated once and frozen (GAP.md, rule 9).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.gap.imprint import Imprint

Array = NDArray[Any]

_ACROSS, _PRESSES, _AHEAD = 30, 8, 12
_FARTHEST = 1.5  # half-widths
_FAITH = 4.0
"""Strokes that must agree before half of what they show is believed."""


class Unevenness(NamedTuple):
    """What is added to coverage."""

    body: Array
    """[across, press]"""
    ends: Array
    """[across, ahead]"""


def unevenness_of(made: Imprint, press_share: Array, table: Unevenness) -> Array:
    """Addition to the coverage of an imprint, float32[B, H, W].

    Args:
        press_share: float64[B, N], 0 the lightest and 1 the deepest press.
    """
    added = np.zeros_like(made.coverage)
    inked, end, across, press, ahead = _places(made, press_share)
    body = _bilinear(table.body, across, press)
    added[inked] = np.where(end, _bilinear(table.ends, across, ahead), body)
    return added


def estimate_unevenness(made: Imprint, press_share: Array, missing: Array, weight: Array) -> Unevenness:
    """Tables from what is missing in coverage, [B, H, W], by its weights [B, H, W]."""
    inked, end, across, press, ahead = _places(made, press_share)
    values, weights, stroke = missing[inked], weight[inked], np.nonzero(inked)[0]
    body = _means(~end, (across, press), (_ACROSS, _PRESSES), values, weights, stroke)
    return Unevenness(body, _means(end, (across, ahead), (_ACROSS, _AHEAD), values, weights, stroke))


def _places(made: Imprint, press_share: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Which pixels count [B, H, W], and of these: whether at an end, and places on the tables' axes, in cells."""
    inked = made.segment >= 0
    stroke, k, t = np.nonzero(inked)[0], made.segment[inked].astype(int), made.along[inked]
    last = press_share.shape[1] - 1
    end = ((k == 0) & (t <= 0)) | ((k >= last - 1) & (t >= 1))
    press = press_share[stroke, k] * (1 - t) + press_share[stroke, np.minimum(k + 1, last)] * t
    left, ahead = made.place[inked].T
    return (
        inked,
        end,
        np.clip((left / _FARTHEST + 1) / 2, 0, 1) * (_ACROSS - 1),
        np.clip(press, 0, 1) * (_PRESSES - 1),
        np.clip(np.abs(ahead) / _FARTHEST, 0, 1) * (_AHEAD - 1),
    )


def _means(
    which: Array, places: tuple[Array, Array], shape: tuple[int, int], values: Array, weights: Array, stroke: Array
) -> Array:
    """Weighted mean in each cell of a table, drawn towards 0 where few strokes have been."""
    row, column = (np.rint(place[which]).astype(int) for place in places)
    cell, size = row * shape[1] + column, shape[0] * shape[1]
    weight, value = weights[which], values[which]
    mass = np.bincount(cell, weight, size)
    mean = np.bincount(cell, weight * value, size) / np.maximum(mass, 1e-9)
    seen = np.unique(np.stack([cell[weight > 0], stroke[which][weight > 0]]), axis=1)
    strokes = np.bincount(seen[0], minlength=size)
    return (mean * strokes / (strokes + _FAITH)).reshape(shape)


def _bilinear(table: Array, row: Array, column: Array) -> Array:
    i, j = (np.minimum(place.astype(int), n - 2) for place, n in ((row, table.shape[0]), (column, table.shape[1])))
    u, v = row - i, column - j
    upper = table[i, j] * (1 - v) + table[i, j + 1] * v
    lower = table[i + 1, j] * (1 - v) + table[i + 1, j + 1] * v
    return upper * (1 - u) + lower * u
