"""The best pairing of two sets, as the style objective needs it (thesis 4.2): exact, compiled, without SciPy.

Shortest augmenting paths with dual prices (Jonker and Volgenant 1987; in the form of Crouse 2016), as SciPy's
``linear_sum_assignment``: cubic time in the number of points.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pentimento.render.coverage import compiled

FloatArray = NDArray[np.float64]

MAX_CELLS: Final = 256
"""In a pairing; as in ``semantics.style.style``."""


def best_partners(ways: FloatArray) -> NDArray[np.int64]:
    """For each row of finite ``ways`` [N, N] the column [N] of its partner: the pairing of least total way."""
    return np.asarray(_partners(np.ascontiguousarray(ways, dtype=np.float64)))


def ways_between(points: NDArray[np.float32], others: NDArray[np.float32]) -> FloatArray:
    """Euclidean distances [N, N] from each of ``points`` [N, D] to each of ``others`` [N, D]."""
    squares = np.zeros((len(points), len(others)))
    for one, other in zip(points.T.astype(np.float64), others.T.astype(np.float64), strict=True):
        squares += np.square(one[:, None] - other)
    return np.asarray(np.sqrt(squares))


@compiled
def _partners(ways: Any) -> Any:
    count = ways.shape[0]
    row_price, column_price = np.zeros(count), np.zeros(count)
    column_of, row_of = np.full(count, -1, np.int64), np.full(count, -1, np.int64)
    for start in range(count):
        shortest = np.full(count, np.inf)
        before = np.full(count, -1, np.int64)
        reached = np.zeros(count, np.bool_)
        row, so_far, end = start, 0.0, -1
        while end < 0:
            nearest, length = -1, np.inf
            for column in range(count):
                if reached[column]:
                    continue
                through = so_far + ways[row, column] - row_price[row] - column_price[column]
                if through < shortest[column]:
                    shortest[column] = through
                    before[column] = row
                if shortest[column] < length or (shortest[column] == length and row_of[column] < 0):
                    nearest, length = column, shortest[column]
            so_far = length
            reached[nearest] = True
            if row_of[nearest] < 0:
                end = nearest
            else:
                row = row_of[nearest]
        row_price[start] += so_far
        for column in range(count):
            if reached[column]:
                if row_of[column] >= 0:
                    row_price[row_of[column]] += so_far - shortest[column]
                column_price[column] -= so_far - shortest[column]
        column = end
        while True:
            row = before[column]
            row_of[column] = row
            column_of[row], column = column, column_of[row]
            if row == start:
                break
    return column_of
