"""From a table of pushes to what is wrong with the analytic model: find, confirm, measure on sealed pushes, say what is
left. As on strokes (``diagnosis/strokes/diagnose.py``), and with the same statistics.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import combine_pvalues
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from pentimento.contracts.statistics import interval, resamples
from pentimento.diagnosis.evaluation import Floor
from pentimento.diagnosis.gauss_newton import covariance
from pentimento.diagnosis.pushes.borderline import confirmations, with_one_borderline
from pentimento.diagnosis.pushes.fit import equalised, fit, fit_without
from pentimento.diagnosis.pushes.floor import floor_of_test_split, floor_while_searching
from pentimento.diagnosis.pushes.jacobian import action_losses, linearise
from pentimento.diagnosis.pushes.learned_residual import LearnedPushResidual, learn_residual
from pentimento.diagnosis.pushes.measured import MeasuredPushes
from pentimento.diagnosis.pushes.misattribution import (
    goes_with_place,
    goes_with_time,
    lookalike_is_as_good,
    shows_signature,
)
from pentimento.diagnosis.pushes.modes import MODES, mode_scores, unexplained
from pentimento.diagnosis.pushes.search import Search, observable_causes, search
from pentimento.diagnosis.pushes.splits import Parts, split_pushes
from pentimento.diagnosis.residual_structure import TemporalDrift, Unexplained, temporal_drift
from pentimento.diagnosis.score import paired_p, unconfirmed
from pentimento.diagnosis.verdict import Finding
from pentimento.dynamics.pushes.analytic import AnalyticPush, first_model, typical
from pentimento.dynamics.pushes.mechanisms import Mechanism

Array = NDArray[Any]

_PASSES = 2
_CONFIRMED_BESIDE_P, _SURE_P, _CERTAIN_P, _DENIED_P = 0.1, 0.01, 0.001, 0.05
_DRAWS = 1999
_MIN_GAIN = 0.01
"""Of the gap on sealed pushes, and of the noise floor: what is worth less explains nothing."""
_MIN_IF_ALIASABLE, _MIN_IF_SURE, _MIN_OF_WHAT_IS_LEFT = 0.025, 0.0125, 0.4
"""Of the noise floor (the second where scores are sure of a cause), and of the error that is left above it for certain:
what a cause must remove of sealed pushes that a base which is wrong about shapes can look like. Where much more is left
than it takes away, it is one of many ways in which the base is wrong."""
_SMALLEST_GAP = 0.1
"""Of the gap: below it a resampled gap is no measure for anything."""


@dataclass(frozen=True)
class PushDiagnosis:
    """Everything that the verdict and the report say."""

    parts: Parts
    measured: MeasuredPushes
    """The pushes, with the tool's habits."""
    learned_residual: LearnedPushResidual
    search: Search
    extended: AnalyticPush
    """The base with the established causes, fitted to all but the sealed pushes."""
    base: AnalyticPush
    """The same without them."""
    established: tuple[Finding, ...]
    suspected: tuple[Finding, ...]
    floor: Floor | None
    drifts: TemporalDrift | None
    """What neighbours in time share: a state that nobody recorded, unless a recorded column goes with it."""
    base_losses: Array
    """Of each sealed action, mm²."""
    extended_losses: Array
    unexplained: tuple[Unexplained, ...]
    mode_strength: Array
    covariates: tuple[str, ...]

    @property
    def gap_closed(self) -> tuple[float, tuple[float, float]] | None:
        """(base - extended) / (base - floor) on sealed pushes, and 95 % of it; None without a floor, and where the gap
        is less than how well the floor is known: sealed pushes that are not repeated have noise of their own.
        """
        if self.floor is None or self.base_losses.mean() - self.floor.mse <= self.floor.standard_error:
            return None
        fall = self.base_losses - self.extended_losses
        gap = self.base_losses - self.floor.mse
        drawn = resamples(len(gap), _DRAWS, [11])
        shares = fall[drawn].mean(1) / np.maximum(gap[drawn].mean(1), _SMALLEST_GAP * gap.mean())
        return float(fall.mean() / gap.mean()), interval(shares)


@threadpool_limits.wrap(1)  # as for strokes
def diagnose(
    measured: MeasuredPushes, vocabulary: Sequence[type[Mechanism]], seed: int, log: Callable[[str], None]
) -> PushDiagnosis:
    """Diagnose measured pushes.

    Raises:
        ContractError: too few actions.
    """
    parts = split_pushes(measured, seed)
    plain = measured.pick(parts.discovery_split)
    first = fit(first_model(plain.scene), plain)
    weighed = equalised(measured, first)
    base = model = fit(first, weighed.pick(parts.discovery_split))
    observable, _ = observable_causes(plain, vocabulary)
    # Twice where causes are found: in a residual that still holds their effects, habits are hard to see.
    for _ in range(_PASSES):
        before = {mechanism.cause for mechanism in model.mechanisms}
        unfound = [mechanism for cause, mechanism in observable.items() if cause not in before]
        learned_residual, weighed = learn_residual(weighed, model, parts.discovery_split, unfound, seed)
        weighed = equalised(weighed, model)
        floor_share = floor_while_searching(model, weighed, parts.discovery_split, seed)
        found = search(base, weighed.pick(parts.discovery_split), floor_share, vocabulary, seed, log)
        if found.found == before:
            break
        base, model = found.base, found.model
    learned_residual, weighed = learned_residual.learnt_from_all(weighed, parts.discovery_split)
    measured = replace(weighed, weight=np.ones_like(weighed.weight))
    test = measured.pick(parts.test_split)
    known, plainly = weighed.pick(parts.discovery_split), measured.pick(parts.discovery_split)
    test_split = np.isin(np.unique(weighed.action), weighed.action[parts.test_split])
    discovery_split = found
    found = with_one_borderline(discovery_split, known, weighed, test_split, seed, log)
    named = list(found.model.mechanisms)
    confirmed_p = confirmations(found.model, weighed, test_split, seed)
    lost = unconfirmed([m.cause for m in named], confirmed_p, _CONFIRMED_BESIDE_P)
    sure = _sure(discovery_split, confirmed_p)
    noise = floor_while_searching(found.model, weighed, parts.discovery_split, seed)
    of_use = _of_use(
        found.model.without(*lost), found.base, known, weighed.pick(parts.test_split), noise, confirmed_p, sure, seed,
    )  # fmt: skip
    misattributed = _misattributed(of_use, known, seed)
    of_use = of_use.without(*misattributed)
    base = fit(found.base, plainly)
    extended = fit(of_use, plainly) if of_use.mechanisms else base
    floor = floor_of_test_split(extended, measured, parts.test_split, seed)
    drifts = temporal_drift(MODES, *mode_scores(extended, measured), measured.action, measured.turn, seed)
    if floor and drifts:
        floor = floor.moved(-drifts.mse_of_repeats)
    base_losses, extended_losses = action_losses(base, test), action_losses(extended, test)
    above = base_losses.mean() - (floor.mse if floor and floor.mse < base_losses.mean() else 0.0)
    chosen = {step.chosen: step for step in found.steps if step.chosen}

    def finding(model: AnalyticPush, mechanism: Mechanism) -> Finding:
        left = action_losses(fit_without(model, mechanism.cause, base, plainly), test)
        fall = (left - action_losses(model, test)) / above
        bounds = interval(fall[resamples(len(fall), _DRAWS, [seed, 12])].mean(1))
        step = chosen[mechanism.cause]
        return Finding(
            mechanism.cause, step.evidence[mechanism.cause].p_adjusted, confirmed_p[mechanism.cause],
            float(fall.mean()), bounds, values_with_errors(model, mechanism.cause, plainly),
            step.rivals, missed_without=float(left.mean()),
        )  # fmt: skip

    def is_idle(finding: Finding) -> bool:
        cause = finding.cause
        return _is_idle(finding, observable[cause], above, floor, extended_losses, cause in sure)

    established = tuple(finding(extended, m) for m in extended.mechanisms)
    while idle := [f for f in established if is_idle(f)]:
        worst = min(idle, key=lambda f: f.gain).cause
        extended = base if len(established) == 1 else fit(extended.without(worst), plainly)
        extended_losses = action_losses(extended, test)
        established = tuple(finding(extended, m) for m in extended.mechanisms)
    # What is established itself is no other explanation of its neighbour.
    names = {f.cause for f in established}
    established = tuple(replace(f, rivals=tuple(r for r in f.rivals if r not in names)) for f in established)
    doubtful = [m for m in named if m.cause not in names]
    suspected = tuple(
        replace(finding(fit(extended.plus(m), plainly), m), misattributed=m.cause in misattributed) for m in doubtful
    )
    left, strength, covariates = unexplained(extended, known, seed)
    return PushDiagnosis(
        parts, measured, learned_residual, found, extended, base, established, suspected, floor, drifts, base_losses,
        extended_losses, tuple(left), strength, tuple(covariates),
    )  # fmt: skip


def _of_use(
    model: AnalyticPush,
    base: AnalyticPush,
    known: MeasuredPushes,
    test_split: MeasuredPushes,
    floor: float,
    confirmed_p: Mapping[str, float],
    sure: Collection[str],
    seed: int,
) -> AnalyticPush:
    """The model less the causes that are of no use on pushes that nothing was fitted to, with the weights that make
    pushes equal: of all alike, the few that are wrong by most would decide.

    One goes at a time: of two causes that can do each other's work, neither is of use beside the other.

    Args:
        floor: the noise floor, weighted as errors are, mm²; 0 where it is unknown.
        sure: causes that scores are sure of: the errors of sealed pushes must only not deny them.
    """
    if not model.mechanisms:
        return model
    base = fit(base, known)
    gap = float(action_losses(base, test_split).mean()) - floor
    while model.mechanisms:
        model = fit(model, known)
        losses, spare = action_losses(model, test_split), {}
        for m in model.mechanisms:
            falls = action_losses(fit_without(model, m.cause, base, known), test_split) - losses
            values = values_with_errors(model, m.cause, known) if m.signature or m.by_place else {}
            could_be_shape = _could_be_shape(m, values)
            if not _only_surely_denied(could_be_shape, confirmed_p[m.cause]) or paired_p(-falls, seed) <= _DENIED_P:
                minimum = 0.0 if m.cause in sure else _MIN_GAIN * max(gap, floor)
                spare[m.cause] = float(falls.mean()) - minimum
        worst = min(spare, key=lambda cause: spare[cause], default=None)
        if worst is None or spare[worst] >= 0:
            break
        model = model.without(worst)
    return model


def _misattributed(model: AnalyticPush, known: MeasuredPushes, seed: int) -> list[str]:
    """Causes that stand where something belongs that has no name.

    Args:
        model: fitted to ``known``.
    """
    return [
        m.cause
        for m in model.mechanisms
        if (m.signature and not shows_signature(m, values_with_errors(model, m.cause, known)))
        or lookalike_is_as_good(m.cause, model, known, seed)
    ]


def _min_error(floor: Floor, extended_losses: Array, sure: bool) -> float:
    """What a cause that a base can look like must remove of the error of sealed pushes, mm²; less of what is noise
    where scores are ``sure`` of it.
    """
    left = float(extended_losses.mean()) - floor.interval[1]
    return max((_MIN_IF_SURE if sure else _MIN_IF_ALIASABLE) * floor.mse, _MIN_OF_WHAT_IS_LEFT * left)


def _is_idle(
    finding: Finding, mechanism: Mechanism, above: float, floor: Floor | None, extended_losses: Array, sure: bool
) -> bool:
    """Whether sealed pushes, all alike, are worse with a cause, or not so much better as they must be with one that a
    base can look like.

    Args:
        above: the error of the base above the floor, of which the gain is a share, mm².
        sure: whether scores are sure of it.
    """
    if finding.gain < 0 and _can_deny(finding, mechanism):
        return True
    if floor is None or not _could_be_shape(mechanism, finding.values):
        return False
    return finding.gain * above < _min_error(floor, extended_losses, sure)


def _can_deny(finding: Finding, mechanism: Mechanism) -> bool:
    """Whether sealed pushes that are worse with a cause, all alike, deny it. The few that are wrong by most say how
    much error falls there: too little to deny what is certain.
    """
    if _only_surely_denied(_could_be_shape(mechanism, finding.values), finding.confirmed_p):
        return finding.gain_interval[1] < 0
    return finding.confirmed_p > _CERTAIN_P


def _could_be_shape(mechanism: Mechanism, values: Mapping[str, tuple[float, float]]) -> bool:
    """Whether a base that is wrong about shapes could look like a cause with these values, each with its error."""
    return mechanism.aliasable and not goes_with_time(mechanism, values) and not goes_with_place(mechanism, values)


def _only_surely_denied(could_be_shape: bool, confirmed_p: float) -> bool:
    """Whether a cause goes only where sealed pushes are surely worse with it: where no base can look like it, and their
    scores speak for it. They are few, and their errors cannot tell little from nothing.
    """
    return not could_be_shape and confirmed_p <= _CONFIRMED_BESIDE_P


def _sure(discovery_split: Search, confirmed_p: Mapping[str, float]) -> set[str]:
    """Causes that the scores of sealed pushes are sure of, or those of searched and sealed ones together (Fisher 1925):
    the sealed had no part in the search.

    Args:
        searched: before a cause in doubt was taken: with it, its p has the sealed pushes in it.
    """
    at_the_end = discovery_split.steps[-1].evidence
    p_discovery = {cause: evidence.p_adjusted for cause, evidence in at_the_end.items()}
    p_discovery |= {step.chosen: step.evidence[step.chosen].p_adjusted for step in discovery_split.steps if step.chosen}
    return {
        cause
        for cause, p in confirmed_p.items()
        if p <= _SURE_P or combine_pvalues([p_discovery[cause], p], method="fisher").pvalue <= _CERTAIN_P
    }


def values_with_errors(model: AnalyticPush, cause: str, measured: MeasuredPushes) -> dict[str, tuple[float, float]]:
    """Each quantity of a fitted mechanism with its cluster-robust standard error, in its unit, by name."""
    spread = np.diag(covariance(linearise(model, measured)))
    fitted = next(m for m in model.mechanisms if m.cause == cause)
    errors = np.sqrt(np.maximum(spread[model.columns_of(cause)], 0.0)) * typical(fitted)
    return {
        q.name: (float(value), float(error))
        for q, value, error in zip(fitted.quantities, fitted.values, errors, strict=True)
    }
