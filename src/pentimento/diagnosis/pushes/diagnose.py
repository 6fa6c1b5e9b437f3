"""Diagnosis of a table of pushes: find causes in the discovery split, confirm and value them on the test split.

The statistics are those of strokes (``diagnosis/strokes/diagnose.py``). ``diagnose`` runs three steps: ``_discover``
fits the base, learns the residual and searches for causes; ``establish.decide`` decides which of them are kept, from
scores and errors alone; ``_evaluate`` refits and measures what each cause is worth on the test split.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from pentimento.diagnosis.evaluation import Floor, mean_gain
from pentimento.diagnosis.pushes.establish import Decision, decide, is_superfluous, values_with_errors
from pentimento.diagnosis.pushes.fit import equalised, fit, fit_without
from pentimento.diagnosis.pushes.floor import floor_in_search, floor_of_test_split
from pentimento.diagnosis.pushes.jacobian import action_losses
from pentimento.diagnosis.pushes.learned_residual import LearnedPushResidual, learn_residual
from pentimento.diagnosis.pushes.measured import MeasuredPushes, PushSplits, split_pushes
from pentimento.diagnosis.pushes.modes import MODES, mode_scores, structured_residual
from pentimento.diagnosis.pushes.search import Search, observable_causes, search
from pentimento.diagnosis.temporal_drift import temporal_drift
from pentimento.diagnosis.verdict import DiagnosisResult, Finding
from pentimento.dynamics.pushes.analytic import AnalyticPush, first_model
from pentimento.dynamics.pushes.mechanisms import Mechanism

Array = NDArray[Any]

_PASSES = 2
"""Rounds of residual learning and search; the second only where the first found causes."""


@dataclass(frozen=True, kw_only=True)
class PushDiagnosis(DiagnosisResult):
    """The result of a diagnosis of pushes; losses in mm²."""

    splits: PushSplits
    measured: MeasuredPushes
    """The pushes, with their learned residual."""
    learned_residual: LearnedPushResidual
    search: Search
    extended: AnalyticPush
    """The base with the established causes, fitted to the discovery split."""
    base: AnalyticPush
    """The same without them."""

    @property
    def smallest_gap(self) -> float:
        """The floor's standard error: single test pushes have noise of their own."""
        return self.floor.standard_error if self.floor else 0.0


@dataclass(frozen=True)
class _Discovery:
    """Result of the discovery split."""

    weighted: MeasuredPushes
    """All pushes, with fit weights and the learned residual."""
    learned_residual: LearnedPushResidual
    search: Search


@threadpool_limits.wrap(1)  # small matrices: threads cost more than they give
def diagnose(
    measured: MeasuredPushes, vocabulary: Sequence[type[Mechanism]], seed: int, *, log: Callable[[str], None]
) -> PushDiagnosis:
    """Diagnose measured pushes.

    Raises:
        ContractError: too few actions.
    """
    splits = split_pushes(measured, seed)
    found = _discover(measured, splits, vocabulary, seed, log=log)
    decision = decide(found.search, found.weighted, splits, seed, log=log)
    return _evaluate(found, decision, splits, seed)


def _discover(
    measured: MeasuredPushes,
    splits: PushSplits,
    vocabulary: Sequence[type[Mechanism]],
    seed: int,
    *,
    log: Callable[[str], None],
) -> _Discovery:
    """Fit the base, learn the residual, search for causes; the learned residual is refitted in the end."""
    rows = splits.discovery
    unweighted = measured.pick(rows)
    first = fit(first_model(unweighted.scene), unweighted)
    weighted = equalised(measured, first)
    base = model = fit(first, weighted.pick(rows))
    observable, _ = observable_causes(unweighted, vocabulary)
    for _ in range(_PASSES):
        before = {mechanism.cause for mechanism in model.mechanisms}
        unfound = [mechanism for cause, mechanism in observable.items() if cause not in before]
        learned_residual, weighted = learn_residual(weighted, model, rows, candidates=unfound, seed=seed)
        weighted = equalised(weighted, model)
        noise = floor_in_search(model, weighted, rows, seed)
        found = search(base, weighted.pick(rows), noise, vocabulary=vocabulary, seed=seed, log=log)
        if found.found == before:
            break
        base, model = found.base, found.model
    learned_residual, weighted = learned_residual.refitted(weighted, rows)
    return _Discovery(weighted, learned_residual, found)


@dataclass(frozen=True)
class _Valuation:
    """Unweighted pushes on which findings are valued, and the error of the base there."""

    base: AnalyticPush
    discovery: MeasuredPushes
    test: MeasuredPushes
    gap: float
    """Error of the base above the floor, mm²; gains are fractions of it."""
    decision: Decision
    seed: int

    def of(self, model: AnalyticPush, mechanism: Mechanism) -> Finding:
        """The finding of one mechanism of a fitted model."""
        cause = mechanism.cause
        left = action_losses(fit_without(model, cause, self.base, self.discovery), self.test)
        gain, interval = mean_gain((left - action_losses(model, self.test)) / self.gap, self.seed)
        step = next(step for step in reversed(self.decision.search.steps) if step.chosen == cause)
        return Finding(
            cause, step.evidence[cause].p_adjusted, self.decision.confirmed_p[cause], gain,
            interval, values_with_errors(model, cause, self.discovery), step.rivals,
            misattributed=cause in self.decision.misattributed, missed_without=float(left.mean()),
        )  # fmt: skip


def _evaluate(found: _Discovery, decision: Decision, splits: PushSplits, seed: int) -> PushDiagnosis:
    """Refit without weights, and measure errors, floor and findings on the test split."""
    measured = replace(found.weighted, weight=np.ones_like(found.weighted.weight))
    discovery, test = measured.pick(splits.discovery), measured.pick(splits.test)
    base = fit(decision.search.base, discovery)
    extended = fit(decision.model, discovery) if decision.model.mechanisms else base
    floor = floor_of_test_split(extended, measured, splits.test, seed)
    drifts = temporal_drift(MODES, mode_scores(extended, measured), measured.action, turn=measured.turn, seed=seed)
    if floor and drifts:
        floor = floor.moved(-drifts.mse_of_repeats)
    base_losses = action_losses(base, test)
    gap = base_losses.mean() - (floor.mse if floor and floor.mse < base_losses.mean() else 0.0)
    valuation = _Valuation(base, discovery, test, gap, decision, seed)
    extended, established = _without_superfluous(extended, valuation, floor)
    # An established cause is no alternative explanation of another one.
    names = {f.cause for f in established}
    established = tuple(replace(f, rivals=tuple(r for r in f.rivals if r not in names)) for f in established)
    suspected = tuple(
        valuation.of(fit(extended.plus(m), discovery), m)
        for m in decision.search.model.mechanisms
        if m.cause not in names
    )
    structure = structured_residual(extended, found.weighted.pick(splits.discovery), seed)
    return PushDiagnosis(
        splits=splits,
        measured=measured,
        learned_residual=found.learned_residual,
        search=decision.search,
        extended=extended,
        base=base,
        established=established,
        suspected=suspected,
        floor=floor,
        drifts=drifts,
        base_losses=base_losses,
        extended_losses=action_losses(extended, test),
        unexplained=structure.unexplained,
        mode_strength=structure.strength,
        covariates=structure.covariates,
    )


def _without_superfluous(
    extended: AnalyticPush, valuation: _Valuation, floor: Floor | None
) -> tuple[AnalyticPush, tuple[Finding, ...]]:
    """The extended model without causes that the test split does not support, one at a time, and its findings."""
    decision = valuation.decision
    while True:
        losses = action_losses(extended, valuation.test)
        findings = tuple(valuation.of(extended, m) for m in extended.mechanisms)
        superfluous = [
            f
            for f in findings
            if is_superfluous(
                f,
                decision.search.observable[f.cause],
                valuation.gap,
                floor,
                losses=losses,
                sure=f.cause in decision.sure,
            )
        ]
        if not superfluous:
            return extended, findings
        worst = min(superfluous, key=lambda f: f.gain).cause
        extended = valuation.base if len(findings) == 1 else fit(extended.without(worst), valuation.discovery)
