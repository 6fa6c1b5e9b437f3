"""Paint that a tool takes up where it crosses what is there already, and carries along."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pentimento.diagnosis.strokes.soft_edge import Imprint

Array = NDArray[Any]


def picked_up(made: Imprint, paint: Array, below: Array, painted: Array) -> Array:
    """By how much the paint of a tool that takes up all that it crosses differs from its own, float32[B, H, W, 3].

    What is crossed is stirred in on the spot and carried along from there, by the renderer's law (``composition``).

    Args:
        paint: [B, 1, 1, 3] linear light, the tool's own.
        below: [B, H, W, 3] what is there before.
        painted: [B, H, W] how much paint that is, 0 to 1.
    """
    change = np.zeros_like(below)
    for b in np.flatnonzero((painted * made.coverage).sum((1, 2)) > 0):
        _take_up(made.segment[b], made.coverage[b], paint[b, 0, 0], below[b], painted[b], change[b])
    return change


@njit(cache=True, error_model="numpy", nogil=True)
def _take_up(segment: Array, coverage: Array, paint: Array, below: Array, painted: Array, change: Array) -> None:
    """Fill ``change`` [H, W, 3] of one stroke."""
    height, width = segment.shape
    passed = np.zeros(segment.max() + 1)
    sums = np.zeros((len(passed), 3))
    for row in range(height):
        for column in range(width):
            k = segment[row, column]
            if k >= 0:
                covered = max(coverage[row, column], 0.0)
                passed[k] += covered
                for c in range(3):
                    change[row, column, c] = painted[row, column] * (below[row, column, c] - paint[c])
                    sums[k, c] += covered * change[row, column, c]
    for k in range(1, len(passed)):
        passed[k] += passed[k - 1]
        sums[k] += sums[k - 1]
    for row in range(height):
        for column in range(width):
            k = segment[row, column]
            if k >= 0:
                for c in range(3):
                    change[row, column, c] += sums[k, c] / max(passed[k], 1e-6)
