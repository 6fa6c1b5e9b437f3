"""What each action has of its own in what is to be learnt of all: where it came to lie, how wide, how deep.

That is chance. It hides what is alike in all actions, and trees that are to learn the one would fit the other.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def action_effect(values: Array, by: Array, weight: Array, row: Array) -> Array:
    """Of ``values`` of pixels what combinations of ``by``, another for each row, come nearest to, [n].

    Args:
        values: [n].
        by: [n, K]: how each pixel changes with K numbers of its row.
        weight: [n] of each pixel's squared error.
        row: [n], which row it is of.
    """
    rows = int(row.max()) + 1

    def summed(columns: Array) -> Array:
        return np.stack([np.bincount(row, column, rows) for column in columns.T], axis=1)

    pairs = weight[:, None, None] * by[:, :, None] * by[:, None, :]
    curvature = summed(pairs.reshape(len(by), -1)).reshape(rows, by.shape[1], by.shape[1])
    slope = summed((weight * values)[:, None] * by)
    amounts = np.linalg.pinv(curvature, hermitian=True) @ slope[..., None]
    return np.asarray((by * amounts[row, :, 0]).sum(1))
