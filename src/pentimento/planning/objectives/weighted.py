"""Weighted sums of objectives (thesis 4.3.5, eq. 4.5), each term's own value kept for the log."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from torch import Tensor

Objective = Callable[[Tensor], Tensor]
"""An image [H, W, 3] in linear light to a scalar to lower, differentiable."""


@dataclass(frozen=True)
class Term:
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

    def __call__(self, image: Tensor) -> Tensor:
        """The sum for an image [H, W, 3] in linear light; a scalar, differentiable."""
        return self.total(self.values(image))

    def values(self, image: Tensor) -> dict[str, Tensor]:
        """Each term's value by name, not weighted: what to log."""
        return {term.name: term.objective(image) for term in self._terms}

    def total(self, values: Mapping[str, Tensor]) -> Tensor:
        """The sum of what ``values`` gave."""
        weighted = [term.weight * values[term.name] for term in self._terms]
        return sum(weighted[1:], weighted[0])
