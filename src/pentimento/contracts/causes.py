"""What the causes of strokes and of pushes share: their quantities, and the reason why one cannot be told."""

from __future__ import annotations

from typing import NamedTuple

from pentimento.contracts.errors import PentimentoError


class Quantity(NamedTuple):
    """One number of a mechanism."""

    name: str
    unit: str
    typical: float
    """The size of a typical effect."""
    signed: bool = True
    """Whether it may be below 0. A tip cannot lead its command, for example."""


class NotObservable(PentimentoError):
    """A cause is not identifiable from these data: a covariate was not recorded or did not vary."""
