"""Adam (Kingma & Ba 2015) on arrays in place, and the schedule of its rate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]

_BETAS = (0.85, 0.97)
"""Decay of the first and the second moment. Runs have a few to tens of iterations. With the usual 0.999 the first
gradients would set the scale of a whole run."""
_EPSILON = 1e-8
"""Added to the root of the second moment, as published."""


class Adam:
    """The moments of the gradients of several arrays. All keep the arrays' precision."""

    def __init__(self, arrays: Sequence[Array], scales: Sequence[Array | None] | None = None) -> None:
        """Hold arrays, which ``step`` changes in place.

        Args:
            arrays: of any shape.
            scales: for each array the unit of its elements, of a shape that broadcasts to it, or None for 1. Gradients
                are taken and steps are made in this unit, so that elements of different magnitude move evenly.
        """
        self._arrays = arrays
        self._scales = [None] * len(arrays) if scales is None else scales
        self._mean = [np.zeros_like(array) for array in arrays]
        self._square = [np.zeros_like(array) for array in arrays]
        self._steps = 0

    def step(self, gradients: Sequence[Array], rates: Sequence[float]) -> None:
        """Move each array against its gradient, by about its rate."""
        self._steps += 1
        first, second = (1 - beta**self._steps for beta in _BETAS)
        for array, scale, mean, square, own_gradient, rate in zip(
            self._arrays, self._scales, self._mean, self._square, gradients, rates, strict=True
        ):
            gradient = own_gradient if scale is None else own_gradient * scale
            mean += (1 - _BETAS[0]) * (gradient - mean)
            square += (1 - _BETAS[1]) * (gradient * gradient - square)
            before = None if scale is None else array.copy()
            array -= (rate / first) * mean / (np.sqrt(square / second) + _EPSILON)
            if scale is not None and before is not None:
                array[:] = before + (array - before) * scale


def half_cosine(iteration: int, iterations: int, first: float, last: float) -> float:
    """From ``first`` at iteration 0 to ``last`` at ``iterations`` along half a cosine, with slope 0 at both ends."""
    return float(last + (first - last) * 0.5 * (1 + np.cos(np.pi * iteration / iterations)))
