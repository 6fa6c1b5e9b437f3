"""Random streams of the studio: one for each item, so that what happens to an item depends on nothing but
its id.
"""

from enum import IntEnum

import numpy as np


class Item(IntEnum):
    """Kind of an item that draws random numbers."""

    SHEET = 1
    TOOL = 2
    DIP = 3
    STROKE = 4
    PHOTO = 5
    TABLE = 6
    SLAB = 7
    PUSH = 8
    SCAN = 9
    ROOM = 10


def item_rng(seed: int, kind: Item, index: int) -> np.random.Generator:
    """Generator of item `index` of its `kind` in the world's `seed`."""
    return np.random.default_rng([seed, int(kind), index])
