"""The interface between the diagnosis and a simulator with its measured actions (docs/diagnose_your_simulator.md).

The engine knows neither strokes nor clay. It asks a ``Problem`` for fits, errors and derivatives, and compares actions.
Parameters of causes are in units of their typical size, so that 1 is a typical effect.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.evaluation import Floor
from pentimento.diagnosis.gauss_newton import Statistics
from pentimento.diagnosis.residual_structure import ModeScores

Array = NDArray[Any]


class Quantity(NamedTuple):
    """One number of a cause."""

    name: str
    unit: str
    typical: float
    """The size of a typical effect, in ``unit``."""
    signed: bool = True
    """Whether it may be below 0."""


@dataclass(frozen=True)
class Cause:
    """A possible cause of the gap between model and measurement. With all quantities at 0 it changes nothing."""

    name: str
    quantities: tuple[Quantity, ...]
    covariates: tuple[str, ...] = ()
    """Covariates of an action that the effect depends on."""
    family: str = ""
    """Causes of one family are compared with each other even where only one of them is significant."""
    signature: tuple[str, ...] = ()
    """Quantities of which one must differ from 0 for the cause to deserve its name; empty: any."""
    named: bool = True
    """False for a part of the model that competes with causes but is none, such as a tool's uneven ends."""
    is_possible: Callable[[Array], bool] | None = None
    """Whether fitted values [Q], in typical sizes, make sense together; None: the signs decide."""

    def allows(self, values: Array) -> bool:
        """Whether the fitted values [Q], in typical sizes, are possible, and not all 0."""
        signs = np.any(values) and all(q.signed or value >= 0 for q, value in zip(self.quantities, values, strict=True))
        return bool(signs) and (self.is_possible is None or self.is_possible(values))


@dataclass(frozen=True)
class Rows:
    """What is known of B executed actions beside their measurement."""

    action: Array
    """int[B]: rows of equal value repeat one command."""
    block: Array
    """int[B]: rows of equal value share a condition that nobody measured, such as one load of paint or ten minutes of a
    session. They stay in one split as far as possible, so that what they share is not taken for confirmation. Where
    nothing is shared, the same as ``action``."""
    turn: Array
    """int[B]: rank in the order of execution, which shows drift: 0, 1, 2, … where rows are in that order."""
    covariates: Mapping[str, Array]
    """float[B] each, without gaps, by name."""

    @property
    def first_of_action(self) -> Array:
        """Index of the first row of each action [n], in the order of the action numbers."""
        return np.asarray(np.unique(self.action, return_index=True)[1])

    def pick(self, rows: Array) -> Rows:
        """The rows with these indices."""
        columns = {name: values[rows] for name, values in self.covariates.items()}
        return Rows(self.action[rows], self.block[rows], self.turn[rows], columns)


class Fitted(Protocol):
    """A fitted model: nuisances, then the quantities of its causes."""

    @property
    def causes(self) -> tuple[str, ...]:
        """Names, in the order of their parameters."""

    @property
    def vector(self) -> Array:
        """[P] parameters: of the base first, then of each cause, in typical sizes."""


M = TypeVar("M", bound=Fitted)


class Problem(Protocol[M]):
    """Measured rows and the model that should predict them. Errors are mean squares in ``unit``."""

    @property
    def kind(self) -> str:
        """What the rows are, in sentences: "strokes", "pushes" or another plural."""

    @property
    def unit(self) -> str:
        """Of the errors, for people."""

    @property
    def rows(self) -> Rows:
        """The measured rows."""

    @property
    def causes(self) -> Mapping[str, Cause]:
        """The vocabulary, as far as the rows can show it, by name."""

    @property
    def unobservable(self) -> Mapping[str, str]:
        """Causes that the rows cannot show, and why."""

    @property
    def modes(self) -> tuple[str, ...]:
        """Names of the residual modes: the ways in which an action can deviate as a whole."""

    def pick(self, rows: Array) -> Self:
        """The problem with some rows."""

    def prepared(self) -> Self:
        """The problem after choices that its fits need and that its own rows make, such as weights."""

    def fit(self, causes: Sequence[str], start: M | None = None) -> M:
        """The base with these causes, fitted to the rows.

        Args:
            causes: names.
            start: a fitted model to start from. Its further causes are left out.
        """

    def losses(self, model: M) -> Array:
        """Mean squared error of each action, [n]."""

    def linearise(self, model: M, candidates: Sequence[str]) -> Statistics:
        """Sums by action for the model's parameters, followed by those of the ``candidates`` at 0.

        The curvature includes the prior of the fit, if it has one; the slope does not.
        """

    def floor(self, model: M) -> Floor | None:
        """The noise floor, from repeated actions; None where too few are repeated."""

    def mode_scores(self, model: M) -> ModeScores:
        """Amounts of the residual modes in each row."""

    def learn_residual(self, model: M, candidates: Sequence[str]) -> tuple[Self, Callable[[Self], Self]]:
        """What a learned model says about all actions alike, beyond the base and the ``candidates``.

        Returns:
            This problem with cross-fitted predictions of the learned model, and a function that gives other rows of the
            same problem the predictions of the model learned from all these rows. A problem without a learned model
            returns itself and the identity.
        """


def columns_of(problem: Problem[M], model: M, cause: str) -> Array:
    """Indices of a cause's quantities among the model's parameters."""
    sizes = [len(problem.causes[name].quantities) for name in model.causes]
    at = len(model.vector) - sum(sizes) + sum(sizes[: model.causes.index(cause)])
    return np.arange(at, at + len(problem.causes[cause].quantities))


def values_of(problem: Problem[M], model: M, cause: str) -> Array:
    """A cause's quantities in typical sizes, [Q]."""
    return np.asarray(model.vector[columns_of(problem, model, cause)])
