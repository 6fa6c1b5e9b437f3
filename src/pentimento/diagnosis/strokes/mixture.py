"""How paint and what is below it mix where paint covers a pixel in part: a mean of a power of their light.

In linear light areas mix, as a camera sees a fine pattern; the numbers of an sRGB picture are about its power 0.45, in
which drawing programs mix; towards power 0 paint is a filter that dims by a share.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_DARKEST = 1e-3
"""Linear light that a power is taken of at least."""


def mixture(below: Array, paint: Array, coverage: Array, power: float) -> Array:
    """Paint over what is below it: linear light, by a mean of its ``power``; what is to be mixed is not quite black."""
    if power == 1:
        return np.asarray(below + coverage * (paint - below))
    raised, laid = (np.maximum(light, _DARKEST) ** np.float32(power) for light in (below, paint))
    mixed: Array = np.maximum(raised + coverage * (laid - raised), _DARKEST**power) ** np.float32(1 / power)
    return mixed


def slopes_of_mixture(below: Array, paint: Array, coverage: Array, power: float) -> tuple[Array, Array]:
    """Derivatives of ``mixture`` by coverage and by paint."""
    if power == 1:
        return paint - below, np.broadcast_to(coverage, below.shape)
    mixed = mixture(below, paint, coverage, power)
    raised, laid = (np.maximum(light, _DARKEST) ** np.float32(power) for light in (below, paint))
    steepness = mixed ** np.float32(1 - power)
    of_paint = coverage * steepness * np.maximum(paint, _DARKEST) ** np.float32(power - 1)
    return steepness * (laid - raised) / np.float32(power), of_paint
