"""What verdict, leaderboard and figures need of a diagnosis, whatever was diagnosed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple, Protocol

from numpy.typing import NDArray

from pentimento.diagnosis.choice import Step
from pentimento.diagnosis.strokes.aliasing import Aliasing
from pentimento.diagnosis.strokes.diagnose import Finding
from pentimento.diagnosis.strokes.floor import Floor
from pentimento.diagnosis.strokes.modes import Unexplained
from pentimento.diagnosis.strokes.screening import Dependence
from pentimento.diagnosis.temporal_drift import TemporalDrift

Array = NDArray[Any]


class Kind(NamedTuple):
    """What the rows are."""

    name: str
    """Of the table, and of its rows in a sentence."""
    unit: str
    """Of mean squared errors."""


STROKES = Kind("strokes", "sRGB")
PUSHES = Kind("pushes", "mm²")


class Searched(Protocol):
    """See ``diagnosis.strokes.search.Search``."""

    @property
    def steps(self) -> tuple[Step, ...]:
        """Rounds of the search."""

    @property
    def not_observable(self) -> dict[str, str]:
        """Causes that could not be looked for, and why."""


class Told(Protocol):
    """A mechanism of strokes or of pushes."""

    cause: ClassVar[str]

    @property
    def informative_covariates(self) -> tuple[str, ...]:
        """Columns that its effect goes with."""


class Extended(Protocol):
    """A model with the established causes."""

    @property
    def mechanisms(self) -> Sequence[Told]:
        """One for each cause."""


class Judged(Protocol):
    """See ``diagnosis.strokes.diagnose.Diagnosis``."""

    @property
    def extended(self) -> Extended:
        """The base with the established causes."""

    @property
    def search(self) -> Searched:
        """How causes were found."""

    @property
    def established(self) -> tuple[Finding, ...]:
        """Causes."""

    @property
    def suspected(self) -> tuple[Finding, ...]:
        """Causes."""

    @property
    def floor(self) -> Floor | None:
        """None where no action is repeated."""

    @property
    def drifts(self) -> TemporalDrift | None:
        """What neighbours in time share: a state that nobody recorded, unless a recorded column goes with it."""

    @property
    def base_losses(self) -> Array:
        """Of each sealed action."""

    @property
    def extended_losses(self) -> Array:
        """Of each sealed action."""

    @property
    def gap_closed(self) -> tuple[float, tuple[float, float]] | None:
        """Share, and 95 % of it."""

    @property
    def unexplained(self) -> tuple[Unexplained, ...]:
        """What is left."""


class Surveyed(Protocol):
    """See ``diagnosis.strokes.screening.Survey``."""

    @property
    def modes(self) -> tuple[str, ...]:
        """Ways in which a row can differ as a whole."""

    @property
    def aliasing(self) -> Aliasing:
        """Which causes the rows can tell apart."""

    @property
    def detectable(self) -> Mapping[str, float]:
        """Smallest share of the error that each cause must remove to be found."""

    @property
    def base_strength(self) -> Array:
        """[modes, covariates]"""

    @property
    def extended_strength(self) -> Array:
        """[modes, covariates]"""

    @property
    def covariates(self) -> tuple[str, ...]:
        """What modes may depend on."""

    @property
    def dependence(self) -> tuple[Dependence, ...]:
        """The strongest pairs."""
