"""The order of painting: few changes of paint, and light over dark only once the dark has had time to dry.

A plan's strokes lie over each other in the order in which they were optimised, coarse below fine. Ordered from light to
dark throughout (thesis 4.3.5) the picture becomes another one wherever a lighter stroke lay over a darker. Here the
brush goes through the paints from light to dark several times. A stroke waits for those under it: in the same sweep if
their paint is its own or lighter, to the next one if it is darker. Where overlaps would take more sweeps than wanted,
those that show least are given up.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pentimento.render.coverage import compiled

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def sweep_order(covers: FloatArray, colors_srgb: FloatArray, paint: IntArray, sweeps: int) -> IntArray:
    """The order [S] in which to make strokes, as indices into the order in which they lie now.

    Args:
        covers: [S, P] how much each stroke covers each pixel, 0 to 1.
        colors_srgb: [S, 3] of the strokes.
        paint: [S] which paint each takes, numbered from light to dark.
        sweeps: at most so many times through the paints; 1 is from light to dark throughout.
    """
    shows = overlaps(covers, colors_srgb)
    weights = np.unique(shows[shows > 0])
    low, high = 0, len(weights)  # number of weakest overlaps that are given up
    while low < high:
        middle = (low + high) // 2
        if _sweeps(shows, paint, weights[middle - 1] if middle else 0.0).max(initial=0) < sweeps:
            high = middle
        else:
            low = middle + 1
    sweep = _sweeps(shows, paint, weights[low - 1] if low else 0.0)
    return np.lexsort((np.arange(len(paint)), paint, sweep))


def overlaps(covers: FloatArray, colors_srgb: FloatArray) -> FloatArray:
    """[S, S] how much it would show if stroke i lay over the later stroke j: seen overlap times colour difference²."""
    difference = np.square(colors_srgb[:, None] - colors_srgb).sum(-1)
    return np.triu(_seen_over(covers, visible(covers)) * difference, k=1)


def visible(covers: FloatArray) -> FloatArray:
    """[S, P] the share of each pixel's light that is each stroke's, under those that lie over it."""
    shown = covers.copy()
    left = np.ones_like(covers[0])
    for s in range(len(covers) - 1, -1, -1):
        shown[s] *= left
        left *= 1 - covers[s]
    return shown


def paint_changes(paint: IntArray) -> int:
    """How often the brush is washed."""
    return int(np.count_nonzero(np.diff(paint)))


@compiled
def _sweeps(shows: FloatArray, paint: IntArray, given_up: float) -> IntArray:
    """[S] the sweep of each stroke, where overlaps up to ``given_up`` do not count."""
    sweep = np.zeros(len(paint), np.int64)
    for i in range(len(paint)):
        for j in range(i + 1, len(paint)):
            if shows[i, j] > given_up:
                sweep[j] = max(sweep[j], sweep[i] + (1 if paint[i] > paint[j] else 0))
    return sweep


@compiled
def _seen_over(covers: FloatArray, shown: FloatArray) -> FloatArray:
    """[S, S] covers @ shown.T, by pixel: few strokes cover one."""
    total = np.zeros((len(covers), len(covers)))
    here = np.empty(len(covers), np.int64)
    for p in range(covers.shape[1]):
        count = 0
        for s in range(len(covers)):
            if covers[s, p] > 0.0:
                here[count] = s
                count += 1
        for i in range(count):
            for j in range(i, count):
                total[here[i], here[j]] += covers[here[i], p] * shown[here[j], p]
    return total
