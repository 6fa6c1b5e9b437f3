"""Diagnosis in three steps: search on the discovery split, decision with the confirmation split, report on the test
split.

``decide`` gets a problem without the test rows, so that no decision can depend on them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from pentimento.diagnosis.decision import Decision, default_decision
from pentimento.diagnosis.evaluation import SMALLEST_GAP, Floor, fraction_of_gap, mean_gain
from pentimento.diagnosis.evidence import Evidence, Examined, evidence_for
from pentimento.diagnosis.gauss_newton import covariance
from pentimento.diagnosis.problem import M, Problem, columns_of
from pentimento.diagnosis.residual_structure import Structure, find_structure
from pentimento.diagnosis.rule import DEFAULT_RULE, DecisionRule
from pentimento.diagnosis.search import Test, above_floor, score_tests, search
from pentimento.diagnosis.splits import Splits, split
from pentimento.diagnosis.temporal_drift import TemporalDrift, temporal_drift

Array = NDArray[Any]


@dataclass(frozen=True)
class Decided(Generic[M]):
    """What the discovery and the confirmation split say."""

    known: Problem[M]
    """Both splits, with the learned residual."""
    predict_residual: Callable[[Problem[M]], Problem[M]]
    """Gives other rows of the same problem the learned residual."""
    model: M
    """The base with the causes that are at least suspected, fitted to both splits."""
    probability: dict[str, float]
    """Of each of these causes."""
    examined: dict[str, Examined]
    """Every proposed cause, when it was accepted or rejected."""


@dataclass(frozen=True)
class Finding:
    """One cause with its gain on the test split."""

    cause: str
    probability: float
    gain: float
    """Share of the base's error above the floor that it removes."""
    gain_interval: tuple[float, float]
    """95 %."""
    values: dict[str, tuple[float, float]]
    """Each quantity with its standard error, in its unit."""
    evidence: Evidence
    rivals: tuple[str, ...]
    """Causes that remove as much in its place and are not established."""
    mse_without: float
    """Error of the model without it on the test split."""


@dataclass(frozen=True)
class Result(Generic[M]):
    """The outcome of a diagnosis."""

    problem: Problem[M]
    """All rows, as given."""
    splits: Splits
    """Of these rows."""
    decided: Decided[M]
    test: Problem[M]
    """The test split, with the learned residual."""
    base: M
    """Without causes, fitted outside the test split."""
    extended: M
    """The base with the established causes, fitted likewise."""
    established: tuple[Finding, ...]
    suspected: tuple[Finding, ...]
    """Each beside the established causes."""
    others: dict[str, Test]
    """Score tests of all other causes at the decided model, outside the test split."""
    base_losses: Array
    """Error of the base on each action of the test split."""
    extended_losses: Array
    floor: Floor | None
    """Without what a temporal drift adds to the variance of repeats; None where too few actions are repeated."""
    drift: TemporalDrift | None
    """A residual mode that drifts with the order of execution."""
    structure: Structure
    """What the residual modes of the extended model still depend on."""

    @property
    def known(self) -> Problem[M]:
        """The rows outside the test split, with the learned residual."""
        return self.decided.known

    @property
    def gap_closed(self) -> tuple[float, tuple[float, float]] | None:
        """(base - extended) / (base - floor) on the test split with its 95 % interval; None without a gap."""
        if self.floor is None or self.base_losses.mean() <= self.floor.interval[1]:
            return None
        return fraction_of_gap(self.base_losses, self.extended_losses, self.floor.mse)


@threadpool_limits.wrap(1)  # the matrices are too small for threads
def diagnose(
    problem: Problem[M],
    *,
    seed: int,
    log: Callable[[str], None],
    decision: Decision | None = None,
    rule: DecisionRule = DEFAULT_RULE,
) -> Result[M]:
    """Diagnose measured rows.

    Args:
        problem: the rows with their model.
        seed: of splits, folds, sign flips and bootstraps.
        log: gets lines of progress.
        decision: probability of a cause by its evidence; by default the one that ships.
        rule: limits.

    Raises:
        ContractError: too few actions.
    """
    splits = split(problem.rows, seed)
    rows = np.sort(np.concatenate(splits[:2]))
    known = problem.pick(rows).prepared()
    confirmation = np.isin(np.unique(known.rows.action), problem.rows.action[splits.confirmation])
    decided = decide(known, confirmation, decision or default_decision(problem.kind), rule, seed=seed, log=log)
    return report(decided, problem, splits, rule, seed=seed)


def decide(
    known: Problem[M],
    confirmation: Array,
    decision: Decision,
    rule: DecisionRule,
    *,
    seed: int,
    log: Callable[[str], None],
) -> Decided[M]:
    """Search for causes on the discovery split and decide about each with the confirmation split.

    Args:
        known: discovery and confirmation split.
        confirmation: whether an action belongs to the confirmation split, bool[n].
        decision: probability of a cause by its evidence.
        rule: limits.
        seed: of folds and sign flips.
        log: gets lines of progress.
    """
    rows = np.flatnonzero(~np.isin(known.rows.action, np.unique(known.rows.action)[confirmation]))
    discovery = known.pick(rows)
    model = search(discovery, discovery.fit(()), rule, seed=seed, log=log, min_share=rule.large_share)
    candidates = [name for name in known.causes if name not in model.causes]
    known, predict_residual = known.learn_residual(known.fit(model.causes, model), candidates)
    discovery = known.pick(rows)
    model = discovery.fit(model.causes, model)
    model = search(discovery, model, rule, seed=seed, log=log, min_share=rule.small_share)
    gap = above_floor(known, known.fit(()))
    examined: dict[str, Examined] = {}
    while True:
        now = evidence_for(known, model, confirmation, rule, gap=gap, seed=seed)
        examined |= now
        probability = {name: decision.probability(e.evidence) for name, e in now.items() if known.causes[name].named}
        worst = min(probability, key=lambda name: probability[name], default=None)
        if worst is None or probability[worst] >= rule.suspected:
            break
        log(f"{worst}: probability {probability[worst]:.2f}")
        model = discovery.fit([name for name in model.causes if name != worst], model)
    return Decided(known, predict_residual, known.fit(model.causes, model), probability, examined)


def report(decided: Decided[M], problem: Problem[M], splits: Splits, rule: DecisionRule, *, seed: int) -> Result[M]:
    """Errors and gains on the test split, and the structure that the extended model leaves in the other rows."""
    known, test = decided.known, decided.predict_residual(problem.pick(splits.test))
    unnamed = [name for name in decided.model.causes if not known.causes[name].named]
    sure = [name for name, p in decided.probability.items() if p >= rule.established]
    base = known.fit(unnamed, decided.model)
    extended = known.fit([*unnamed, *sure], decided.model)
    base_losses, extended_losses = test.losses(base), test.losses(extended)
    rows, scores = known.rows, known.mode_scores(extended)
    drift = temporal_drift(known.modes, scores, rows.action, turn=rows.turn, seed=seed)
    floor = test.floor(extended) or known.floor(extended)
    if floor and drift:
        floor = floor.moved(-drift.mse_of_repeats)
    error = float(base_losses.mean())
    gap = max(error - (floor.mse if floor else 0.0), SMALLEST_GAP * error)

    def finding(cause: str) -> Finding:
        others = [name for name in extended.causes if name != cause]
        with_it = extended if cause in extended.causes else known.fit([*others, cause], decided.model)
        without = extended if with_it is not extended else known.fit(others, extended)
        losses = test.losses(without)
        gain, interval = mean_gain((losses - test.losses(with_it)) / gap, seed)
        examined = decided.examined[cause]
        return Finding(
            cause=cause,
            probability=decided.probability[cause],
            gain=gain,
            gain_interval=interval,
            values=values_with_errors(known, with_it, cause),
            evidence=examined.evidence,
            rivals=tuple(name for name in examined.rivals if name not in sure and known.causes[name].named),
            mse_without=float(losses.mean()),
        )

    left = [name for name in known.causes if name not in decided.model.causes and known.causes[name].named]
    return Result(
        problem=problem,
        splits=splits,
        decided=decided,
        test=test,
        base=base,
        extended=extended,
        established=tuple(finding(name) for name in sure),
        suspected=tuple(finding(name) for name in decided.probability if name not in sure),
        others=score_tests(known, decided.model, left, seed=seed),
        base_losses=base_losses,
        extended_losses=extended_losses,
        floor=floor,
        drift=drift,
        structure=find_structure(known.modes, scores, rows.covariates, action=rows.action, seed=seed),
    )


def values_with_errors(problem: Problem[M], model: M, cause: str) -> dict[str, tuple[float, float]]:
    """Each quantity of a fitted cause with its standard error, in its unit."""
    columns = columns_of(problem, model, cause)
    spread = np.sqrt(np.maximum(np.diag(covariance(problem.linearise(model, ())))[columns], 0.0))
    return {
        q.name: (float(value) * q.typical, float(error) * q.typical)
        for q, value, error in zip(problem.causes[cause].quantities, model.vector[columns], spread, strict=True)
    }


def gap_closed_on(outside: Problem[M], result: Result[M], *, base: M, extended: M) -> float | None:
    """(base - extended) / (base - floor) on rows of another table, with its own floor where it repeats actions.

    None where no floor is known, or where the base has no gap there.

    Args:
        outside: a problem with the same vocabulary.
        result: of the diagnosed table.
        base: ``result.base`` as it is for the other rows.
        extended: ``result.extended`` likewise.
    """
    outside = result.decided.predict_residual(outside)
    floor = outside.floor(extended) or result.floor
    before, after = float(outside.losses(base).mean()), float(outside.losses(extended).mean())
    if floor is None or before <= floor.mse:
        return None
    return (before - after) / (before - floor.mse)
