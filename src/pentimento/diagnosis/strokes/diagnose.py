"""Diagnosis of measured strokes: select causes, confirm them, decide by their gain on the test split, and report."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from pentimento.diagnosis.evaluation import Splits, split
from pentimento.diagnosis.score import unconfirmed
from pentimento.diagnosis.strokes.establish import Decision, Problem, decide, without_causes
from pentimento.diagnosis.strokes.fit import choose_mixing, first_model, fit, huber_weighted
from pentimento.diagnosis.strokes.large_effects import find_large
from pentimento.diagnosis.strokes.learned_residual import LearnedResidual, learn_residual
from pentimento.diagnosis.strokes.measured import Measured, covariates_shown
from pentimento.diagnosis.strokes.misattribution import uneven_ends_suffice, with_uneven_ends
from pentimento.diagnosis.strokes.model import Model, UnevenEnds
from pentimento.diagnosis.strokes.modes import MODES, evaluate_modulator, mode_scores, structured_residual
from pentimento.diagnosis.strokes.predict import action_losses, mean_squared_error, noise_floor, residual
from pentimento.diagnosis.strokes.search import (
    Search,
    accept_borderline,
    confirmation_p,
    recheck_alternatives,
    search,
)
from pentimento.diagnosis.temporal_drift import temporal_drift
from pentimento.diagnosis.verdict import DiagnosisResult
from pentimento.dynamics.strokes.simulation import Mechanism

Array = NDArray[Any]

_CONFIRMED_BESIDE_P = 0.05
"""Confirmation p up to which a further cause is confirmed."""
_PASSES = 2
"""Alternations of learning the residual and selecting causes, at most."""


@dataclass(frozen=True, kw_only=True)
class Diagnosis(DiagnosisResult):
    """The result of a diagnosis of strokes; losses in sRGB."""

    splits: Splits
    measured: Measured
    """All strokes, with predictions of the learned residual model."""
    learned_residual: LearnedResidual
    search: Search
    extended: Model
    """The base with the established causes, fitted to all strokes outside the test split."""
    base: Model
    """The same without causes."""


@dataclass(frozen=True)
class Selected:
    """Causes selected on the discovery split, before any decision about them."""

    found: Search
    confirmed_p: dict[str, float]
    """p of each cause on the confirmation split."""
    learned_residual: LearnedResidual
    measured: Measured
    """All strokes with final predictions of the learned residual model and equal weights."""


# The matrices are too small for threads, which on busy cores wait for each other far longer than they work.
@threadpool_limits.wrap(1)
def diagnose(
    measured: Measured, vocabulary: Sequence[type[Mechanism]], seed: int, log: Callable[[str], None]
) -> Diagnosis:
    """Diagnose measured strokes (docs/diagnosis.md).

    Raises:
        ContractError: too few actions.
    """
    splits = split(measured, seed)
    selected = select(measured, splits, vocabulary, seed=seed, log=log)
    problem = problem_of(selected, splits, seed)
    return report(selected, problem, decide(problem, log), splits)


def select(
    measured: Measured, splits: Splits, vocabulary: Sequence[type[Mechanism]], *, seed: int, log: Callable[[str], None]
) -> Selected:
    """Select causes on the discovery split and test them on the confirmation split."""
    unweighted = measured.pick(splits.discovery)
    first = choose_mixing(fit(first_model(unweighted), unweighted), unweighted, seed)
    noise = noise_floor(first, measured, seed)
    error = float(mean_squared_error(residual(first, unweighted), unweighted).mean())
    noise_share = min(noise.mse / error, 1.0) if noise else 0.0
    weighted = huber_weighted(measured, first)
    found = find_large(
        first,
        weighted.pick(splits.discovery),
        measured.context,
        noise_share=noise_share,
        vocabulary=vocabulary,
        seed=seed,
        log=log,
    )
    # Learning and selection alternate: effects that are not in the model yet hide what the trees should learn.
    for _ in range(_PASSES):
        before = found.found
        candidates = [m for cause, m in found.observable.items() if cause not in before]
        learned_residual, weighted = learn_residual(
            weighted, found.model, splits.discovery, candidates=candidates, seed=seed
        )
        weighted = huber_weighted(weighted, found.model)
        found = search(found, weighted.pick(splits.discovery), seed, log)
        if found.found == before:
            break
    outside_test = np.sort(np.concatenate(splits[:2]))
    in_confirmation = np.isin(np.unique(weighted.action[outside_test]), weighted.action[splits.confirmation])
    discovery, known = weighted.pick(splits.discovery), weighted.pick(outside_test)
    found = recheck_alternatives(found, discovery, seed, log)
    found = accept_borderline(found, discovery, known, fresh=in_confirmation, seed=seed, log=log)
    found = _uneven_ends_for_lags(found, discovery, weighted, seed=seed, log=log)
    confirmed_p = {
        m.cause: confirmation_p(found.model, m.cause, known, fresh=in_confirmation, seed=seed)
        for m in found.model.mechanisms
        if not isinstance(m, UnevenEnds)
    }
    learned_residual, weighted = learned_residual.learnt_from_all(weighted, outside_test)
    return Selected(found, confirmed_p, learned_residual, replace(weighted, weight=np.ones(len(weighted))))


def problem_of(selected: Selected, splits: Splits, seed: int) -> Problem:
    """Fit base and extended model outside the test split, and measure noise floor and drift."""
    found, measured = selected.found, selected.measured
    known, test = measured.pick(np.sort(np.concatenate(splits[:2]))), measured.pick(splits.test)
    lost = unconfirmed(list(selected.confirmed_p), selected.confirmed_p, _CONFIRMED_BESIDE_P)
    base = fit(found.base, known)
    extended = base
    if len(lost) < len(selected.confirmed_p):
        extended = fit(without_causes(found.model, lost, found.base), known)
    drifts = temporal_drift(MODES, mode_scores(extended, measured), measured.action, turn=measured.turn, seed=seed)
    floor = noise_floor(extended, test, seed) or noise_floor(extended, measured, seed)
    if floor and drifts:
        floor = floor.moved(-drifts.mse_of_repeats)
    return Problem(
        found=found,
        confirmed_p=selected.confirmed_p,
        base=base,
        extended=extended,
        measured=measured,
        known=known,
        test=test,
        floor=floor,
        drifts=drifts,
        base_losses=action_losses(base, test),
        seed=seed,
    )


def report(selected: Selected, problem: Problem, decision: Decision, splits: Splits) -> Diagnosis:
    """The result with its errors on the test split and the structure that is left unexplained."""
    known, extended = problem.known, decision.extended
    structure = structured_residual(extended, known, covariates_shown(known), seed=problem.seed)
    gains = evaluate_modulator(extended, known, problem.test, left=structure.unexplained, seed=problem.seed).gain_of
    return Diagnosis(
        splits=splits,
        measured=problem.measured,
        learned_residual=selected.learned_residual,
        search=problem.found,
        extended=extended,
        base=problem.base,
        established=decision.established,
        suspected=decision.suspected,
        floor=problem.floor,
        drifts=problem.drifts,
        base_losses=problem.base_losses,
        extended_losses=action_losses(extended, problem.test),
        unexplained=tuple(one._replace(generic_gain=gains[one.mode, one.covariate]) for one in structure.unexplained),
        mode_strength=structure.strength,
        covariates=structure.covariates,
    )


def _uneven_ends_for_lags(
    found: Search, discovery: Measured, measured: Measured, *, seed: int, log: Callable[[str], None]
) -> Search:
    """The selection with uneven ends in the place of a lag, where they explain as much.

    A large lag replaces uneven ends before other causes are known, whose effects at a stroke's ends favour the lag.
    """
    for mechanism in found.model.mechanisms:
        if uneven_ends_suffice(mechanism, found.model, measured, seed):
            log(f"uneven ends explain as much as {mechanism.cause}")
            base, model = (with_uneven_ends(m, discovery) for m in (found.base, found.model.without(mechanism.cause)))
            return replace(found, base=base, model=model)
    return found
