"""A fitted model that is a base with mechanisms, as strokes and pushes have it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from numpy.typing import NDArray

Array = NDArray[Any]


class Named(Protocol):
    """A mechanism, by the name of its cause."""

    @property
    def cause(self) -> str:
        """Name."""


class WithMechanisms(Protocol):
    """A base and its mechanisms."""

    @property
    def mechanisms(self) -> Sequence[Named]:
        """One for each cause."""

    @property
    def vector(self) -> Array:
        """[P] parameters: of the base, then of each mechanism in typical sizes."""


_T = TypeVar("_T", bound=WithMechanisms)


@dataclass(frozen=True)
class FittedModel(Generic[_T]):
    """A model as the engine sees it."""

    model: _T

    @property
    def causes(self) -> tuple[str, ...]:
        """Names, in the order of their parameters."""
        return tuple(mechanism.cause for mechanism in self.model.mechanisms)

    @property
    def vector(self) -> Array:
        """[P] parameters."""
        return self.model.vector
