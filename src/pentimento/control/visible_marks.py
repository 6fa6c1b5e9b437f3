"""How much of what a stroke should have left is there to see."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import srgb_to_linear, to_float

Picture = NDArray[np.uint8]

_FAINT = 0.02
"""Root of the summed squares of a foretold change, over that of one pixel from white to black: below, the camera's
noise says more. In pixels' worth."""


def share_seen(before: Picture, now: Picture, predicted: NDArray[np.float32]) -> float | None:
    """The share of a foretold change that pictures show: about 1 where it happened, 0 where nothing did.

    The least-squares factor c of now − before = c · (foretold − before), in linear light, with both changes freed from
    their mean over the canvas where nothing was foretold (light may change as a whole).

    Args:
        before, now: uint8 sRGB [H, W, 3].
        foretold: [H, W, 3] linear light, from ``before``.

    Returns:
        None where so little was foretold that nothing can be said.
    """
    start = srgb_to_linear(to_float(before))
    meant = predicted - start
    where = np.abs(meant).max(axis=2) > _FAINT
    if where.sum() < _FEWEST:
        return None
    change = srgb_to_linear(to_float(now)) - start
    if not where.all():
        change = change - np.median(change[~where], axis=0)
    return float((change[where] * meant[where]).sum() / np.square(meant[where]).sum())


_FEWEST = 6
"""Pixels that must be foretold to change for a judgement."""
