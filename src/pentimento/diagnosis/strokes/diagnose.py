"""Diagnosis of measured strokes: select causes, confirm them, decide by their gain on the test split, and report."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from pentimento.diagnosis.evaluation import SMALLEST_GAP, Floor, Splits, mean_gain, split
from pentimento.diagnosis.residual_structure import TemporalDrift, temporal_drift
from pentimento.diagnosis.score import unconfirmed
from pentimento.diagnosis.strokes.candidates import can_mimic, form_error_share
from pentimento.diagnosis.strokes.fit import choose_mixing, first_model, fit, huber_weighted, values_with_errors
from pentimento.diagnosis.strokes.large_effects import find_large
from pentimento.diagnosis.strokes.learned_residual import LearnedResidual, learn_residual
from pentimento.diagnosis.strokes.measured import Measured, covariates_shown
from pentimento.diagnosis.strokes.misattribution import (
    generic_curve_suffices,
    shows_signature,
    trails_both_ways,
    trails_by_another_power,
    uneven_ends_suffice,
    with_uneven_ends,
)
from pentimento.diagnosis.strokes.model import Model, UnevenEnds
from pentimento.diagnosis.strokes.modes import MODES, evaluate_modulator, mode_scores, unexplained
from pentimento.diagnosis.strokes.predict import action_losses, mean_squared_error, noise_floor, residual
from pentimento.diagnosis.strokes.search import (
    Search,
    accept_borderline,
    confirmation_p,
    recheck_alternatives,
    search,
)
from pentimento.diagnosis.verdict import DiagnosisResult, Finding
from pentimento.dynamics.strokes.simulation import Mechanism

Array = NDArray[Any]

_CONFIRMED_BESIDE_P, _SURE_P, _CERTAIN_P = 0.05, 0.01, 0.001
"""Confirmation p for a further cause, for one that a small test split must not contradict, and beyond doubt."""
_PASSES = 2
_MIN_GAIN, _MIN_BESIDE = 0.02, 0.05
"""Minimum gain on the test split, as a share of the gap, and of the gain of another cause that this one can mimic.
Where a cause's form is not exact, another one explains a little of its error."""
_FAINT = 0.5
"""The minimum gain is lowered by this factor where both confirmation and test split are certain."""
_GOOD_GAIN = 0.1
"""A smaller gain must be significant on the test split: a base with a wrong profile leaves a little of everything."""
_FEW = 15
"""Actions of the test split below which it cannot tell a small gain from none."""
_SURELY_THERE = 2.0
"""Standard errors from 0 of a cause's only quantity."""


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


@dataclass(frozen=True)
class Problem:
    """Everything that the decision about selected causes depends on."""

    found: Search
    confirmed_p: dict[str, float]
    base: Model
    """Fitted to ``known``."""
    extended: Model
    """The base with the confirmed causes, fitted to ``known``."""
    measured: Measured
    """All strokes."""
    known: Measured
    """The strokes outside the test split."""
    test: Measured
    """The test split."""
    floor: Floor | None
    drifts: TemporalDrift | None
    base_losses: Array
    """Error of the base on each action of the test split."""
    seed: int

    @property
    def selected(self) -> list[Mechanism]:
        """The mechanisms of the selected causes."""
        return [m for m in self.found.model.mechanisms if not isinstance(m, UnevenEnds)]

    def above_floor(self, mse: float) -> float:
        """The part of an error above the noise floor, at least a tenth of the error."""
        return max(mse - self.floor.mse, SMALLEST_GAP * mse) if self.floor else mse

    def without(self, model: Model, causes: Sequence[str]) -> Model:
        """The model without some causes, fitted to ``known``."""
        rest = _without(model, causes, self.base)
        return fit(rest, self.known) if any(m.cause in self.found.observable for m in rest.mechanisms) else self.base


@dataclass(frozen=True)
class Decision:
    """Which selected causes are established."""

    extended: Model
    established: tuple[Finding, ...]
    suspected: tuple[Finding, ...]


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
    selected = select(measured, splits, vocabulary, seed, log)
    problem = problem_of(selected, splits, seed)
    return report(selected, problem, decide(problem, log), splits)


def select(
    measured: Measured, splits: Splits, vocabulary: Sequence[type[Mechanism]], seed: int, log: Callable[[str], None]
) -> Selected:
    """Select causes on the discovery split and test them on the confirmation split."""
    unweighted = measured.pick(splits.discovery)
    first = choose_mixing(fit(first_model(unweighted), unweighted), unweighted, seed)
    noise = noise_floor(first, measured, seed)
    error = float(mean_squared_error(residual(first, unweighted), unweighted).mean())
    noise_share = min(noise.mse / error, 1.0) if noise else 0.0
    weighted = huber_weighted(measured, first)
    found = find_large(first, weighted.pick(splits.discovery), measured.context, noise_share, vocabulary, seed, log)
    # Learning and selection alternate: effects that are not in the model yet hide what the trees should learn.
    for _ in range(_PASSES):
        before = found.found
        candidates = [m for cause, m in found.observable.items() if cause not in before]
        learned_residual, weighted = learn_residual(weighted, found.model, splits.discovery, candidates, seed)
        weighted = huber_weighted(weighted, found.model)
        found = search(found, weighted.pick(splits.discovery), seed, log)
        if found.found == before:
            break
    outside_test = np.sort(np.concatenate(splits[:2]))
    in_confirmation = np.isin(np.unique(weighted.action[outside_test]), weighted.action[splits.confirmation])
    discovery, known = weighted.pick(splits.discovery), weighted.pick(outside_test)
    found = recheck_alternatives(found, discovery, seed, log)
    found = accept_borderline(found, discovery, known, in_confirmation, seed, log)
    found = _uneven_ends_for_lags(found, discovery, weighted, seed, log)
    confirmed_p = {
        m.cause: confirmation_p(found.model, m.cause, known, in_confirmation, seed)
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
        extended = fit(_without(found.model, lost, found.base), known)
    drifts = temporal_drift(MODES, *mode_scores(extended, measured), measured.action, measured.turn, seed)
    floor = noise_floor(extended, test, seed) or noise_floor(extended, measured, seed)
    if floor and drifts:
        floor = floor.moved(-drifts.mse_of_repeats)
    return Problem(
        found,
        selected.confirmed_p,
        base,
        extended,
        measured,
        known,
        test,
        floor,
        drifts,
        action_losses(base, test),
        seed,
    )


def decide(problem: Problem, log: Callable[[str], None]) -> Decision:
    """Which of the confirmed causes are established, by their gain and the misattribution checks."""
    extended = problem.extended
    established = _findings(problem, extended)
    # One at a time: of two causes that can each replace the other, neither has a gain beside the other.
    while useless := [
        f for f in established if not _is_of_use(f, established, problem.found, len(problem.base_losses))
    ]:
        worst = min(useless, key=lambda f: f.gain)
        extended = problem.without(extended, [worst.cause])
        established = _findings(problem, extended)
    misattributed = [f.cause for f in established if _is_misattributed(problem, extended, f)]
    if misattributed:
        log(f"not better than an effect without a name: {', '.join(misattributed)}")
        extended = problem.without(extended, misattributed)
        established = _findings(problem, extended)
    names = {f.cause for f in established}
    # An established cause is no alternative explanation of another one.
    established = tuple(replace(f, rivals=tuple(r for r in f.rivals if r not in names)) for f in established)
    suspected = tuple(
        replace(
            _finding(problem, fit(extended.plus(m), problem.known), m), misattributed=m.cause in misattributed
        )
        for m in problem.selected
        if m.cause not in names
    )  # fmt: skip
    return Decision(extended, established, suspected)


def report(selected: Selected, problem: Problem, decision: Decision, splits: Splits) -> Diagnosis:
    """The result with its errors on the test split and the structure that is left unexplained."""
    known, extended = problem.known, decision.extended
    left, strength, names = unexplained(extended, known, covariates_shown(known), problem.seed)
    gains = evaluate_modulator(extended, known, problem.test, left, problem.seed).gain_of
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
        unexplained=tuple(one._replace(generic_gain=gains[one.mode, one.covariate]) for one in left),
        mode_strength=strength,
        covariates=tuple(names),
    )


def _findings(problem: Problem, model: Model) -> tuple[Finding, ...]:
    return tuple(_finding(problem, model, m) for m in model.mechanisms if not isinstance(m, UnevenEnds))


def _finding(problem: Problem, model: Model, mechanism: Mechanism) -> Finding:
    """A cause of the model with its gain: the error that returns on the test split without it."""
    cause = mechanism.cause
    losses = action_losses(problem.without(model, [cause]), problem.test)
    above = problem.above_floor(float(problem.base_losses.mean()))
    gain, interval = mean_gain((losses - action_losses(model, problem.test)) / above, problem.seed)
    step = next(step for step in reversed(problem.found.steps) if step.chosen == cause)
    return Finding(
        cause=cause,
        p_adjusted=step.evidence[cause].p_adjusted,
        confirmed_p=problem.confirmed_p[cause],
        gain=gain,
        gain_interval=interval,
        values=values_with_errors(model, mechanism, problem.known),
        rivals=step.rivals,
        of_what_is_left=gain * above / problem.above_floor(float(losses.mean())),
        missed_without=float(losses.mean()),
    )


def _is_misattributed(problem: Problem, extended: Model, finding: Finding) -> bool:
    """Whether a cause of the extended model only stands in for an effect without a name."""
    mechanism, seed = problem.found.observable[finding.cause], problem.seed
    return (
        not shows_signature(mechanism, finding.values)
        or trails_by_another_power(mechanism, extended, problem.known)
        or trails_both_ways(mechanism, extended, problem.measured)
        or generic_curve_suffices(
            mechanism, extended, problem.without(extended, [finding.cause]), problem.known, problem.test, seed
        )
    )


def _is_of_use(finding: Finding, established: Sequence[Finding], found: Search, test_actions: int) -> bool:
    """Whether a cause acts, with a possible sign, and gains enough on the test split.

    A small test split cannot tell a small gain from none. There, a cause that the confirmation split supports, and that
    no other established cause can mimic, need only have a positive gain, or one that is not small beside the others.

    Args:
        finding: of the cause.
        established: all findings.
        found: the selection.
        test_actions: number of actions in the test split.
    """
    mechanism = found.observable[finding.cause]
    if any(not q.signed and finding.values[q.name][0] < 0 for q in mechanism.quantities):
        return False
    if len(mechanism.quantities) == 1:  # several quantities may each be uncertain and jointly certain
        ((value, error),) = finding.values.values()
        if abs(value) < _SURELY_THERE * error:
            return False
    mimics = [f for f in established if f is not finding and can_mimic(found.observable[f.cause], mechanism)]
    sure = finding.confirmed_p <= _SURE_P and not mimics and test_actions <= _FEW
    if sure and len(established) == 1:
        return finding.gain > 0
    beyond_doubt = finding.confirmed_p <= _CERTAIN_P and finding.gain_interval[0] > 0
    minimum = _FAINT * _MIN_GAIN if beyond_doubt else _MIN_GAIN
    if (finding.of_what_is_left if beyond_doubt else finding.gain) < minimum:
        return False
    for other in mimics:
        share = form_error_share(found.observable[other.cause], mechanism) if beyond_doubt else _MIN_BESIDE
        if finding.gain < other.gain * min(share, _MIN_BESIDE):
            return False
    if finding.confirmed_p <= _CERTAIN_P:
        return True
    largest = max(f.gain for f in established)
    good = _GOOD_GAIN * largest if sure else max(_GOOD_GAIN, _MIN_BESIDE * largest)
    return finding.gain >= good or finding.gain_interval[0] > 0


def _uneven_ends_for_lags(
    found: Search, discovery: Measured, measured: Measured, seed: int, log: Callable[[str], None]
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


def _without(model: Model, causes: Sequence[str], base: Model) -> Model:
    """The model without some causes, with the base's uneven ends where one of the causes had replaced them.

    Otherwise a cause would be credited with what the base does without it.
    """
    rest = model.without(*causes)
    if not causes or any(isinstance(m, UnevenEnds) for m in rest.mechanisms):
        return rest
    return rest.plus(*(m for m in base.mechanisms if isinstance(m, UnevenEnds)))
