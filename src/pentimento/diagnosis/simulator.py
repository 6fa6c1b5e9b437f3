"""A problem of the diagnosis from one function: predictions of a simulator for given parameters.

Everything else (fits, derivatives, noise floor, residual modes) follows from it by finite differences.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.diagnosis.evaluation import Floor, floor_of_repeats
from pentimento.diagnosis.gauss_newton import Statistics, by_action, damped_step, predicted_decrease
from pentimento.diagnosis.problem import Cause, Rows
from pentimento.diagnosis.residual_structure import ModeScores

Array = NDArray[Any]
Predict = Callable[[Array, Mapping[str, float]], Array]
"""From indices of rows [B] and the value of every parameter and quantity, by name, to predictions [B, N]."""

_STEP = 0.01
"""Step of differences, in typical sizes."""
_ITERATIONS = 12
_ENOUGH = 1e-4
"""Relative decrease of the error below which a fit ends."""
_NEARLY_LINEAR = 0.7
"""Share of the predicted decrease of a step above which the derivatives serve the next step, too."""
_PRIOR_WEIGHT = 1e-3
"""Cost of a parameter one typical size from its start, as a share of the error."""


class Parameter(NamedTuple):
    """A nuisance parameter: every fit estimates it."""

    name: str
    start: float
    typical: float
    """A usual deviation from ``start``."""


class _Values(dict[str, float]):
    """Values by name; a name that is missing is an error that says which there are."""

    def __init__(self, values: Mapping[str, float], function: str) -> None:
        super().__init__(values)
        self._function = function

    def __missing__(self, name: str) -> float:
        raise ContractError(
            f"{self._function} asks for {name!r}, which is neither a parameter nor a quantity; there are "
            f"{', '.join(self)}."
        )


@dataclass(frozen=True)
class FittedSimulator:
    """Fitted parameters, as deviations from the start in typical sizes: nuisances, then the causes' quantities."""

    causes: tuple[str, ...]
    vector: Array


@dataclass(frozen=True, eq=False)
class SimulatorProblem:
    """Measured rows [B, N] and a simulator that predicts them."""

    predict: Predict
    measured: Array
    """float[B, N], all rows."""
    parameters: tuple[Parameter, ...]
    """Nuisances; each is a residual mode, too."""
    causes: Mapping[str, Cause]
    all_rows: Rows
    kind: str
    unit: str
    seed: int
    index: Array
    """int[B'] the rows of this part of the table; at first all of them, 0, 1, …, B − 1."""

    def __post_init__(self) -> None:
        """Check the shapes of what was measured and the names of covariates.

        Raises:
            ContractError: a shape differs, or a cause depends on a covariate that no row has.
        """
        rows = len(self.measured)
        if self.measured.ndim != 2:
            raise ContractError(f"measured has the shape {self.measured.shape}; it is [B, N]: a line for each row.")
        columns = {"action": self.all_rows.action, "block": self.all_rows.block, "turn": self.all_rows.turn}
        for name, column in (columns | dict(self.all_rows.covariates)).items():
            if column.shape != (rows,):
                raise ContractError(f"{name} of Rows has the shape {column.shape}; measured has {rows} rows.")
        for cause in self.causes.values():
            if unknown := [name for name in cause.covariates if name not in self.all_rows.covariates]:
                raise ContractError(
                    f"The cause {cause.name} has the covariate {unknown[0]!r}, which Rows lacks; it has "
                    f"{', '.join(self.all_rows.covariates)}."
                )

    @property
    def rows(self) -> Rows:
        """See ``Problem``."""
        return self.all_rows.pick(self.index)

    @property
    def unobservable(self) -> Mapping[str, str]:
        """Every cause that is given is looked for."""
        return {}

    @property
    def modes(self) -> tuple[str, ...]:
        """See ``Problem``."""
        return tuple(parameter.name for parameter in self.parameters)

    def pick(self, rows: Array) -> Self:
        """See ``Problem``."""
        return replace(self, index=self.index[rows])

    def prepared(self) -> Self:
        """Nothing to choose."""
        return self

    def fit(self, causes: Sequence[str], start: FittedSimulator | None = None) -> FittedSimulator:
        """See ``Problem``.

        Raises:
            ContractError: measured or predicted values are not finite.
        """
        model = self._started(tuple(causes), start)
        hold, low = self._prior(model), self._lowest(model)
        free = np.full(len(model.vector), np.inf)
        loss = self._cost(model, hold)
        if not np.isfinite(loss):
            raise ContractError(
                f"At {self.values(model)} the simulator predicts values that are not finite, or the log holds such "
                "values; mend them, or start from other parameters."
            )
        damping, slopes = 1e-3, self._slopes(model)
        for _ in range(_ITERATIONS):
            statistics = self._statistics(model, slopes)
            for _ in range(6):
                moved = damped_step(
                    model.vector, model.vector, statistics, damping=damping, hold=hold, bounds=(low, free)
                )
                candidate = replace(model, vector=moved)
                new = self._cost(candidate, hold)
                if new < loss:
                    break
                damping *= 10
            else:
                return model
            promised = predicted_decrease(candidate.vector - model.vector, model.vector, statistics, hold)
            is_linear = loss - new > _NEARLY_LINEAR * promised
            gained, model, loss, damping = 1 - new / loss, candidate, new, damping / 10
            if gained < _ENOUGH:
                break
            slopes = slopes if is_linear else self._slopes(model)
        return model

    def losses(self, model: FittedSimulator) -> Array:
        """See ``Problem``."""
        return by_action(np.square(self._residual(model)).mean(1), self.rows.action)

    def linearise(self, model: FittedSimulator, candidates: Sequence[str]) -> Statistics:
        """See ``Problem``."""
        full = self._started((*model.causes, *candidates), model)
        statistics = self._statistics(full, self._slopes(full))
        return statistics._replace(curvature=statistics.curvature + self._prior(full))

    def floor(self, model: FittedSimulator) -> Floor | None:
        """See ``Problem``."""
        rest, rows = self._residual(model)[:, None, :], self.rows
        groups = [np.flatnonzero(rows.action == action) for action in np.unique(rows.action)]
        return floor_of_repeats(rest, np.ones(rest.shape), groups, self.seed)

    def mode_scores(self, model: FittedSimulator) -> ModeScores:
        """See ``Problem``."""
        slopes = self._slopes(model)[: len(self.parameters)]
        rest = self._residual(model)
        energy = np.square(slopes).mean(-1).T
        amounts = np.einsum("pbn,bn->bp", slopes, rest) / rest.shape[1] / np.maximum(energy, 1e-300)
        return ModeScores(amounts, energy, float(np.square(rest).mean()))

    def learn_residual(self, model: FittedSimulator, candidates: Sequence[str]) -> tuple[Self, Callable[[Self], Self]]:
        """No learned model."""
        return self, lambda other: other

    def values(self, model: FittedSimulator) -> dict[str, float]:
        """The value of every parameter and quantity by name; quantities of absent causes are 0."""
        sizes = [(p.name, p.typical) for p in self.parameters]
        sizes += [(q.name, q.typical) for name in model.causes for q in self.causes[name].quantities]
        start = {p.name: p.start for p in self.parameters}
        found = {q.name: 0.0 for cause in self.causes.values() for q in cause.quantities}
        moved = zip(sizes, model.vector, strict=True)
        return found | {name: start.get(name, 0.0) + float(amount) * size for (name, size), amount in moved}

    def _started(self, causes: tuple[str, ...], start: FittedSimulator | None) -> FittedSimulator:
        """A model with these causes and the parameters of ``start`` where it has them."""
        start = start or FittedSimulator((), np.zeros(len(self.parameters)))
        ends = np.cumsum([len(self.parameters), *(len(self.causes[name].quantities) for name in start.causes)])
        base, *values = np.split(start.vector, ends[:-1])
        known = dict(zip(start.causes, values, strict=True))
        own = [known.get(name, np.zeros(len(self.causes[name].quantities))) for name in causes]
        return FittedSimulator(causes, np.concatenate([base, *own]))

    def _residual(self, model: FittedSimulator) -> Array:
        return np.asarray(self.measured[self.index] - self._predicted(model))

    def _predicted(self, model: FittedSimulator) -> Array:
        """Predictions [B', N] of the rows of this part.

        Raises:
            ContractError: the function asks for a name that is neither parameter nor quantity, or returns another
                shape.
        """
        name = f"{self.predict.__module__}.{getattr(self.predict, '__qualname__', 'predict')}"
        predicted = self.predict(self.index, _Values(self.values(model), name))
        expected = len(self.index), self.measured.shape[1]
        if np.shape(predicted) != expected:
            raise ContractError(
                f"{name} returns the shape {np.shape(predicted)} for {expected[0]} rows; expected is {expected}, as of "
                "measured."
            )
        return np.asarray(predicted)

    def _slopes(self, model: FittedSimulator) -> Array:
        """Differences of the predictions, [P, B, N]; one-sided, because each costs a simulation."""
        here = self._predicted(model)
        steps = _STEP * np.eye(len(model.vector))
        moved = [self._predicted(replace(model, vector=model.vector + step)) for step in steps]
        return np.stack([(there - here) / _STEP for there in moved])

    def _statistics(self, model: FittedSimulator, slopes: Array) -> Statistics:
        rest = self._residual(model)
        width = rest.shape[1]
        curvature = np.einsum("pbn,qbn->bpq", slopes, slopes, optimize=True) / width
        slope = np.einsum("pbn,bn->bp", slopes, rest) / width
        rows = (curvature, slope, np.square(rest).mean(1))
        return Statistics(*(by_action(values, self.rows.action) for values in rows))

    def _prior(self, model: FittedSimulator) -> Array:
        own = np.arange(len(model.vector)) < len(self.parameters)
        return np.diag(_PRIOR_WEIGHT * own * np.square(self._residual(model)).mean())

    def _cost(self, model: FittedSimulator, hold: Array) -> float:
        return float(self.losses(model).mean() + model.vector @ hold @ model.vector)

    def _lowest(self, model: FittedSimulator) -> Array:
        signed = [q.signed for name in model.causes for q in self.causes[name].quantities]
        return np.array([-np.inf] * len(self.parameters) + [-np.inf if each else 0.0 for each in signed])
