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

from pentimento.diagnosis.engine.decision import Decision
from pentimento.diagnosis.engine.evidence import Evidence, Examined, evidence_for
from pentimento.diagnosis.engine.problem import M, Problem, columns_of
from pentimento.diagnosis.engine.rule import DecisionRule
from pentimento.diagnosis.engine.search import search
from pentimento.diagnosis.engine.splits import split
from pentimento.diagnosis.evaluation import SMALLEST_GAP, Floor, fraction_of_gap, mean_gain
from pentimento.diagnosis.gauss_newton import covariance
from pentimento.diagnosis.residual_structure import Structure, find_structure

Array = NDArray[Any]


@dataclass(frozen=True)
class Decided(Generic[M]):
    """What the discovery and the confirmation split say."""

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
    """Causes that remove as much in its place."""


@dataclass(frozen=True)
class Result(Generic[M]):
    """The outcome of a diagnosis."""

    extended: M
    """The base with the established causes, fitted outside the test split."""
    established: tuple[Finding, ...]
    suspected: tuple[Finding, ...]
    """Each beside the established causes."""
    decided: Decided[M]
    base_losses: Array
    """Error of the base on each action of the test split."""
    extended_losses: Array
    floor: Floor | None
    structure: Structure
    """What the residual modes of the extended model still depend on."""

    @property
    def gap_closed(self) -> tuple[float, tuple[float, float]] | None:
        """(base - extended) / (base - floor) on the test split with its 95 % interval; None without a gap."""
        if self.floor is None or self.base_losses.mean() <= self.floor.interval[1]:
            return None
        return fraction_of_gap(self.base_losses, self.extended_losses, self.floor.mse)


def diagnose(
    problem: Problem[M], decision: Decision, rule: DecisionRule, *, seed: int, log: Callable[[str], None]
) -> Result[M]:
    """Diagnose measured rows.

    Raises:
        ContractError: too few actions.
    """
    splits = split(problem.rows, seed)
    rows = np.sort(np.concatenate(splits[:2]))
    known = problem.pick(rows).prepared()
    confirmation = np.isin(np.unique(known.rows.action), problem.rows.action[splits.confirmation])
    decided, known, predict_residual = decide(known, confirmation, decision, rule, seed=seed, log=log)
    return report(decided, known, predict_residual(problem.pick(splits.test)), rule, seed=seed)


def decide(
    known: Problem[M],
    confirmation: Array,
    decision: Decision,
    rule: DecisionRule,
    *,
    seed: int,
    log: Callable[[str], None],
) -> tuple[Decided[M], Problem[M], Callable[[Problem[M]], Problem[M]]]:
    """Search for causes on the discovery split and decide about each with the confirmation split.

    Args:
        known: discovery and confirmation split.
        confirmation: whether an action belongs to the confirmation split, bool[n].
        decision: probability of a cause by its evidence.
        rule: limits.
        seed: of folds and sign flips.
        log: gets lines of progress.

    Returns:
        The decision, the problem with its learned residual, and what gives other rows the learned residual.
    """
    rows = np.flatnonzero(~np.isin(known.rows.action, np.unique(known.rows.action)[confirmation]))
    discovery = known.pick(rows)
    model = search(discovery, discovery.fit(()), rule, seed=seed, log=log, min_share=rule.large_share)
    candidates = [name for name in known.causes if name not in model.causes]
    known, predict_residual = known.learn_residual(known.fit(model.causes, model), candidates)
    discovery = known.pick(rows)
    model = discovery.fit(model.causes, model)
    model = search(discovery, model, rule, seed=seed, log=log, min_share=rule.small_share)
    examined: dict[str, Examined] = {}
    while True:
        now = evidence_for(known, model, confirmation, rule, seed)
        examined |= now
        probability = {name: decision.probability(e.evidence) for name, e in now.items() if known.causes[name].named}
        worst = min(probability, key=lambda name: probability[name], default=None)
        if worst is None or probability[worst] >= rule.suspected:
            break
        log(f"{worst}: probability {probability[worst]:.2f}")
        model = discovery.fit([name for name in model.causes if name != worst], model)
    return Decided(known.fit(model.causes, model), probability, examined), known, predict_residual


def report(decided: Decided[M], known: Problem[M], test: Problem[M], rule: DecisionRule, *, seed: int) -> Result[M]:
    """Errors and gains on the test split, and the structure that the extended model leaves in the known rows."""
    unnamed = [name for name in decided.model.causes if not known.causes[name].named]
    sure = [name for name, p in decided.probability.items() if p >= rule.established]
    base = known.fit(unnamed, decided.model)
    extended = known.fit([*unnamed, *sure], decided.model)
    base_losses, extended_losses, floor = test.losses(base), test.losses(extended), test.floor(extended)
    error = float(base_losses.mean())
    gap = max(error - (floor.mse if floor else 0.0), SMALLEST_GAP * error)

    def finding(cause: str) -> Finding:
        others = [name for name in extended.causes if name != cause]
        with_it = extended if cause in extended.causes else known.fit([*others, cause], decided.model)
        without = extended if with_it is not extended else known.fit(others, extended)
        gain, interval = mean_gain((test.losses(without) - test.losses(with_it)) / gap, seed)
        return Finding(
            cause, decided.probability[cause], gain, interval, values_with_errors(known, with_it, cause),
            decided.examined[cause].evidence, decided.examined[cause].rivals,
        )  # fmt: skip

    columns = known.rows.covariates
    structure = find_structure(known.modes, known.mode_scores(extended), columns, action=known.rows.action, seed=seed)
    return Result(
        extended=extended,
        established=tuple(finding(name) for name in sure),
        suspected=tuple(finding(name) for name in decided.probability if name not in sure),
        decided=decided,
        base_losses=base_losses,
        extended_losses=extended_losses,
        floor=floor,
        structure=structure,
    )


def values_with_errors(problem: Problem[M], model: M, cause: str) -> dict[str, tuple[float, float]]:
    """Each quantity of a fitted cause with its standard error, in its unit."""
    columns = columns_of(problem, model, cause)
    spread = np.sqrt(np.maximum(np.diag(covariance(problem.linearise(model, ())))[columns], 0.0))
    return {
        q.name: (float(value) * q.typical, float(error) * q.typical)
        for q, value, error in zip(problem.causes[cause].quantities, model.vector[columns], spread, strict=True)
    }
