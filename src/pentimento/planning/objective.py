"""Objectives of a plan: the print objective (thesis 4.3), and weighted sums (thesis 4.3.5, eq. 4.5)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError
from pentimento.planning.model import Objective
from pentimento.render.reconstruction_loss import seen, squared_error, srgb_of

Array = NDArray[np.float32]


class PrintObjective:
    """Mean squared difference in sRGB between an image and a target, averaged over viewing distances.

    From farther off, the eye averages light over squares before it compares: 1 px is the thesis's (4.3), larger squares
    see tone where a pixel sees only a black line on white.
    """

    def __init__(self, target: Array, distances_px: tuple[int, ...]) -> None:
        """Hold what there is to see of ``target``, [H, W, 3] in linear light.

        Raises:
            ConfigError: the picture is smaller than a distance's square.
        """
        height, width = target.shape[:2]
        if max(distances_px) > min(height, width):
            raise ConfigError(
                f"A viewing distance of {max(distances_px)} px is larger than the picture of {height} x {width} px: "
                "lower the planner's distances_px or raise its pixels_per_m."
            )
        self._seen = [(distance, srgb_of(seen(target, distance))) for distance in distances_px]

    def __call__(self, image: Array) -> tuple[float, Array]:
        """The value for an image [H, W, 3] in linear light, and its gradient, in the image's precision."""
        gradient = np.zeros_like(image)
        share = 1 / len(self._seen)
        value = sum(
            share * squared_error(image, target.astype(image.dtype, copy=False), distance, gradient, share)
            for distance, target in self._seen
        )
        return float(value), gradient


class Term(NamedTuple):
    """One objective of a sum."""

    name: str
    weight: float
    objective: Objective


class WeightedObjective:
    """Σ wᵢ · lᵢ over terms; the thesis's weights are 0 or 1, any from 0 on will do. A weight of 0 is not computed."""

    def __init__(self, terms: tuple[Term, ...]) -> None:
        """Hold the terms.

        Raises:
            ValueError: no weight is above 0, one is below, or two terms share a name.
        """
        names = [term.name for term in terms]
        if len(set(names)) < len(names):
            raise ValueError(f"Two of the objectives {names} share a name: their values could not be told apart.")
        if not all(term.weight >= 0 for term in terms):
            raise ValueError(f"The weights of {names} are {[term.weight for term in terms]}: each must be 0 or more.")
        self._terms = tuple(term for term in terms if term.weight > 0)
        if not self._terms:
            raise ValueError(f"No objective of {names} has a weight above 0: there is nothing to plan for.")

    def __call__(self, image: Array) -> tuple[float, Array]:
        """The sum for an image [H, W, 3] in linear light, and its gradient."""
        total, gradient = 0.0, np.zeros_like(image)
        for term in self._terms:
            value, slope = term.objective(image)
            total += term.weight * value
            gradient += np.float32(term.weight) * slope
        return total, gradient

    def values(self, image: Array) -> dict[str, float]:
        """Each term's value by name, not weighted: what to log."""
        return {term.name: term.objective(image)[0] for term in self._terms}
