"""Diagnosis in three steps: search on the discovery split, decide with the confirmation split, report on the test split.

``decide`` gets a problem without the test rows, so that no decision can depend on them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.engine.decision import Decision
from pentimento.diagnosis.engine.evidence import Evidence, evidence_for
from pentimento.diagnosis.engine.problem import M, Problem
from pentimento.diagnosis.engine.rule import DecisionRule
from pentimento.diagnosis.engine.search import search
from pentimento.diagnosis.engine.splits import split
from pentimento.diagnosis.evaluation import Floor, fraction_of_gap, mean_gain
from pentimento.diagnosis.residual_structure import Structure, find_structure

Array = NDArray[Any]


@dataclass(frozen=True)
class Decided(Generic[M]):
    """What the discovery and the confirmation split say."""

    extended: M
    """The base with the established causes, fitted to both splits."""
    probability: dict[str, float]
    """Of each cause that was proposed and not rejected at once."""
    evidence: dict[str, Evidence]
    """Of every proposed cause, when it was accepted or rejected."""


@dataclass(frozen=True)
class Result(Generic[M]):
    """The outcome of a diagnosis."""

    decided: Decided[M]
    established: dict[str, tuple[float, tuple[float, float]]]
    """For each established cause the share of the gap that it removes on the test split, with its 95 % interval."""
    suspected: tuple[str, ...]
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
    known = problem.pick(rows)
    confirmation = np.isin(np.unique(known.rows.action), problem.rows.action[splits.confirmation])
    decided, known, predict_residual = decide(known, confirmation, decision, rule, seed=seed, log=log)
    return report(decided, known, predict_residual(problem.pick(splits.test)), rule, seed=seed)


def decide(
    known: Problem[M], confirmation: Array, decision: Decision, rule: DecisionRule, *, seed: int, log: Callable[[str], None]
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
    evidence: dict[str, Evidence] = {}
    while True:
        now = evidence_for(known, model, confirmation, rule, seed)
        evidence |= now
        probability = {name: decision.probability(e) for name, e in now.items() if known.causes[name].named}
        worst = min(probability, key=lambda name: probability[name], default=None)
        if worst is None or probability[worst] >= rule.suspected:
            break
        log(f"{worst}: probability {probability[worst]:.2f}")
        model = discovery.fit([name for name in model.causes if name != worst], model)
    kept = [n for n in model.causes if probability.get(n, 1.0) >= rule.established]
    return Decided(known.fit(kept, model), probability, evidence), known, predict_residual


def report(
    decided: Decided[M], known: Problem[M], test: Problem[M], rule: DecisionRule, *, seed: int
) -> Result[M]:
    """Errors and gains on the test split, and the structure that the extended model leaves in the known rows."""
    extended = decided.extended
    established = [name for name in extended.causes if known.causes[name].named]
    base = known.fit([name for name in extended.causes if name not in established])
    base_losses, extended_losses = test.losses(base), test.losses(extended)
    floor = test.floor(extended)
    gap = max(float(base_losses.mean()) - (floor.mse if floor else 0.0), 0.1 * float(base_losses.mean()))
    gains = {}
    for name in established:
        without = known.fit([other for other in extended.causes if other != name], extended)
        gains[name] = mean_gain((test.losses(without) - extended_losses) / gap, seed)
    structure = find_structure(
        known.modes, known.mode_scores(extended), known.rows.covariates, action=known.rows.action, seed=seed
    )
    suspected = tuple(name for name, p in decided.probability.items() if p < rule.established)
    return Result(decided, gains, suspected, base_losses, extended_losses, floor, structure)
