"""Measured pushes as a problem of the diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self, cast

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.diagnose import Result
from pentimento.diagnosis.evaluation import Floor
from pentimento.diagnosis.gauss_newton import Statistics
from pentimento.diagnosis.mechanistic import FittedModel
from pentimento.diagnosis.problem import Cause, Quantity, Rows
from pentimento.diagnosis.pushes.fit import equalised, fit
from pentimento.diagnosis.pushes.floor import noise_floor
from pentimento.diagnosis.pushes.jacobian import KeptColumns, action_losses, linearise, point_of
from pentimento.diagnosis.pushes.learned_residual import learn_residual
from pentimento.diagnosis.pushes.measured import MeasuredPushes
from pentimento.diagnosis.pushes.modes import MODES, mode_scores, varying_covariates
from pentimento.diagnosis.residual_structure import ModeScores
from pentimento.planning.pushes.analytic.mechanisms import UNNAMED, Mechanism
from pentimento.planning.pushes.analytic.mechanisms.mechanism import NotObservable
from pentimento.planning.pushes.analytic.model import AnalyticPush, first_model, identity

Array = NDArray[Any]

FittedPushes = FittedModel[AnalyticPush]
PushResult = Result[FittedPushes]


@dataclass(frozen=True, eq=False)
class PushProblem:
    """Measured pushes and the analytic push model."""

    measured: MeasuredPushes
    base: AnalyticPush
    """Without causes; fitted by ``prepared``."""
    mechanisms: Mapping[str, Mechanism]
    """Of each cause, with all quantities 0."""
    causes: Mapping[str, Cause]
    unobservable: Mapping[str, str]
    seed: int
    kind: str = "pushes"
    unit: str = "mm²"
    modes: tuple[str, ...] = MODES

    @cached_property
    def _kept(self) -> KeptColumns:
        return KeptColumns(self.measured)

    @cached_property
    def _fits(self) -> dict[Hashable, AnalyticPush]:
        """Fitted models by start and causes."""
        return {}

    @property
    def rows(self) -> Rows:
        """See ``Problem``."""
        m = self.measured
        return Rows(m.action, m.block, m.turn, varying_covariates(m))

    def pick(self, rows: Array) -> Self:
        """See ``Problem``."""
        return replace(self, measured=self.measured.pick(rows))

    def prepared(self) -> Self:
        """Weights of the pixels by the errors of the fitted base."""
        base = fit(first_model(self.measured.scene), self.measured)
        return replace(self, base=base, measured=equalised(self.measured, base))

    def fit(self, causes: Sequence[str], start: FittedPushes | None = None) -> FittedPushes:
        """See ``Problem``."""
        model = self.base if start is None else start.model
        model = model.without(*(m.cause for m in model.mechanisms if m.cause not in causes))
        taken = {m.cause for m in model.mechanisms}
        model = model.plus(*(self.mechanisms[name] for name in causes if name not in taken))
        # A base that was bent by a large cause takes many iterations to come back.
        starts = {id(each): each for each in (model, replace(model, base=self.base.base))}
        best = min(starts.values(), key=lambda each: float(action_losses(each, self.measured).mean()))
        key = point_of(best), tuple(m.cause for m in best.mechanisms)
        if key not in self._fits:
            self._fits[key] = fit(best, self.measured, kept=self._kept)
        return FittedPushes(self._fits[key])

    def losses(self, model: FittedPushes) -> Array:
        """See ``Problem``."""
        return action_losses(model.model, self.measured)

    def linearise(self, model: FittedPushes, candidates: Sequence[str]) -> Statistics:
        """See ``Problem``."""
        return linearise(model.model.plus(*(self.mechanisms[name] for name in candidates)), self.measured, self._kept)

    def floor(self, model: FittedPushes) -> Floor | None:
        """See ``Problem``."""
        return noise_floor(model.model, self.measured, self.seed)

    def mode_scores(self, model: FittedPushes) -> ModeScores:
        """See ``Problem``."""
        return mode_scores(model.model, self.measured, self._kept)

    def learn_residual(self, model: FittedPushes, candidates: Sequence[str]) -> tuple[Self, Callable[[Self], Self]]:
        """See ``Problem``."""
        others = [self.mechanisms[name] for name in candidates]
        rows = np.arange(len(self.measured))
        learned, measured = learn_residual(self.measured, model.model, rows, candidates=others, seed=self.seed)

        def predict(other: Self) -> Self:
            of_other = learned.of(other.measured)
            return replace(other, measured=replace(of_other, weight=np.ones_like(of_other.weight)))

        return replace(self, measured=equalised(measured, model.model)), predict


def push_problem(measured: MeasuredPushes, vocabulary: Sequence[type[Mechanism]], seed: int) -> PushProblem:
    """The problem of measured pushes."""
    seen, unseen = observable_causes(measured, (*vocabulary, *UNNAMED))
    unseen = {name: why for name, why in unseen.items() if name not in {kind.cause for kind in UNNAMED}}
    causes = {name: _cause(mechanism) for name, mechanism in seen.items()}
    return PushProblem(measured, first_model(measured.scene), seen, causes, unseen, seed)


def observable_causes(
    measured: MeasuredPushes, vocabulary: Sequence[type[Mechanism]]
) -> tuple[dict[str, Mechanism], dict[str, str]]:
    """The mechanism of each cause that these pushes can show, with all quantities 0; and of the others the reason."""
    seen: dict[str, Mechanism] = {}
    unseen: dict[str, str] = {}
    for kind in vocabulary:
        try:
            seen[kind.cause] = identity(kind, measured.scene)
        except NotObservable as reason:
            unseen[kind.cause] = str(reason)
    return seen, unseen


def with_learned_residual(result: PushResult) -> MeasuredPushes:
    """All pushes with the predictions of the learned residual model, cross-fitted outside the test split."""
    rows = np.sort(np.concatenate(result.splits[:2])), result.splits.test
    measured = cast(PushProblem, result.problem).measured
    learned = np.zeros_like(measured.learned_mm)
    for index, part in zip(rows, (result.known, result.test), strict=True):
        learned[index] = cast(PushProblem, part).measured.learned_mm
    return replace(measured, learned_mm=learned)


def _cause(mechanism: Mechanism) -> Cause:
    typical = np.array([q.typical for q in mechanism.quantities])
    return Cause(
        name=mechanism.cause,
        quantities=tuple(Quantity(*q) for q in mechanism.quantities),
        covariates=mechanism.informative_covariates,
        family=mechanism.driving_covariate,
        signature=mechanism.signature,
        named=type(mechanism) not in UNNAMED,
        is_possible=lambda values: type(mechanism)(values * typical, mechanism.reference).physical,
    )
