"""Adam (Kingma & Ba 2015), on arrays in place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]

_BETAS = (0.85, 0.97)
"""Memory of the mean and of the square: runs are a few to tens of iterations long; with the usual .999 the start of
each run rules all of it."""
_CALM = 1e-8


class Adam:
    """What it remembers of gradients; arrays keep their precision."""

    def __init__(self, arrays: Sequence[Array]) -> None:
        """Hold arrays, which ``step`` moves in place."""
        self._arrays = arrays
        self._mean = [np.zeros_like(array) for array in arrays]
        self._square = [np.zeros_like(array) for array in arrays]
        self._steps = 0

    def step(self, gradients: Sequence[Array], rates: Sequence[float]) -> None:
        """Move each array against its gradient, by about its rate."""
        self._steps += 1
        first, second = (1 - beta**self._steps for beta in _BETAS)
        for array, mean, square, gradient, rate in zip(
            self._arrays, self._mean, self._square, gradients, rates, strict=True
        ):
            mean += (1 - _BETAS[0]) * (gradient - mean)
            square += (1 - _BETAS[1]) * (gradient * gradient - square)
            array -= (rate / first) * mean / (np.sqrt(square / second) + _CALM)
