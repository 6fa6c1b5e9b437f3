"""From a table of strokes to a verdict: find, confirm, measure on sealed strokes, and say what is left."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from pentimento.contracts.statistics import interval, resamples
from pentimento.diagnosis.evaluation import Floor, Splits, split
from pentimento.diagnosis.residual_structure import TemporalDrift, Unexplained, temporal_drift
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
from pentimento.diagnosis.strokes.search import Search, accept_borderline, confirmation_p, recheck_alternatives, search
from pentimento.diagnosis.verdict import Finding
from pentimento.dynamics.strokes.simulation import Mechanism

Array = NDArray[Any]

_CONFIRMED_BESIDE_P, _SURE_P, _CERTAIN_P = 0.05, 0.01, 0.001
_DRAWS = 1999
_PASSES = 2
_MIN_GAIN, _MIN_BESIDE = 0.02, 0.05
"""Of the gap on sealed strokes, and of the largest gain there of its kind, among what displaces the mark or among the
others: what is worth less explains nothing, however sure it is. Where a cause's form is not quite right, another takes
up a little of what it leaves. What is worth as little beside one of the other kind must be sure there."""
_FAINT = 0.5
"""Of the least gain: what will do, and of what the other causes leave of the gap alone, where neither the confirming
strokes nor the sealed ones leave a doubt."""
_GOOD_GAIN = 0.1
"""Of the gap: what is worth less must surely be worth something on sealed strokes. Where the tool's own mark is not
what the base can draw, a little is easily explained by what is not there."""
_FEW = 15
"""Sealed actions."""
_SURELY_THERE = 2.0
"""Standard errors of a cause's only quantity."""
_SMALLEST_GAP = 0.1
"""Of the gap, a resampled one, and of the error, the gap itself: what is smaller is no measure for anything."""


@dataclass(frozen=True)
class Diagnosis:
    """Everything that the verdict and the report say."""

    splits: Splits
    measured: Measured
    """The strokes, with the tool's habits."""
    learned_residual: LearnedResidual
    search: Search
    extended: Model
    """The base with the established causes, fitted to all but the sealed strokes."""
    base: Model
    """The same without them."""
    established: tuple[Finding, ...]
    suspected: tuple[Finding, ...]
    floor: Floor | None
    drifts: TemporalDrift | None
    """What neighbours in time share: a state that nobody recorded, unless a recorded column goes with it."""
    base_losses: Array
    """Of each sealed action, sRGB."""
    extended_losses: Array
    unexplained: tuple[Unexplained, ...]
    mode_strength: Array
    covariates: tuple[str, ...]

    @property
    def gap_closed(self) -> tuple[float, tuple[float, float]] | None:
        """(base - extended) / (base - floor) on sealed strokes, and 95 % of it; None without a floor."""
        if self.floor is None or self.base_losses.mean() <= self.floor.mse:
            return None
        fall = self.base_losses - self.extended_losses
        gap = self.base_losses - self.floor.mse
        drawn = resamples(len(gap), _DRAWS, [11])
        shares = fall[drawn].mean(1) / np.maximum(gap[drawn].mean(1), _SMALLEST_GAP * gap.mean())
        return float(fall.mean() / gap.mean()), interval(shares)


# Matrices are too small for threads, which on busy cores wait for each other a hundred times as long as they work.
@threadpool_limits.wrap(1)
def diagnose(
    measured: Measured, vocabulary: Sequence[type[Mechanism]], seed: int, log: Callable[[str], None]
) -> Diagnosis:
    """Diagnose measured strokes.

    Raises:
        ContractError: too few actions.
    """
    splits = split(measured, seed)
    plain = measured.pick(splits.discovery)
    first = choose_mixing(fit(first_model(plain), plain), plain, seed)
    noise = noise_floor(first, measured, seed)
    error = float(mean_squared_error(residual(first, plain), plain).mean())
    share = min(noise.mse / error, 1.0) if noise else 0.0
    weighed = huber_weighted(measured, first)
    found = find_large(first, weighed.pick(splits.discovery), measured.context, share, vocabulary, seed, log)
    # Twice where causes are found: in a residual that still holds their effects, habits are hard to see.
    for _ in range(_PASSES):
        before = found.found
        unfound = [m for cause, m in found.observable.items() if cause not in before]
        learned_residual, weighed = learn_residual(weighed, found.model, splits.discovery, unfound, seed)
        weighed = huber_weighted(weighed, found.model)
        found = search(found, weighed.pick(splits.discovery), seed, log)
        if found.found == before:
            break
    unsealed = np.sort(np.concatenate(splits[:2]))
    fresh = np.isin(np.unique(weighed.action[unsealed]), weighed.action[splits.confirmation])
    discovery_split, known = weighed.pick(splits.discovery), weighed.pick(unsealed)
    found = accept_borderline(
        recheck_alternatives(found, discovery_split, seed, log), discovery_split, known, fresh, seed, log
    )
    found = _uneven_ends_for_lags(found, discovery_split, weighed, seed, log)
    named = [m for m in found.model.mechanisms if not isinstance(m, UnevenEnds)]
    confirmed_p = {m.cause: confirmation_p(found.model, m.cause, known, fresh, seed) for m in named}
    learned_residual, weighed = learned_residual.learnt_from_all(weighed, unsealed)
    measured = replace(weighed, weight=np.ones(len(weighed)))  # what is told of sealed strokes is told of all alike
    test, known = measured.pick(splits.test), measured.pick(unsealed)
    lost = unconfirmed([m.cause for m in named], confirmed_p, _CONFIRMED_BESIDE_P)
    base = fit(found.base, known)
    extended = base if len(lost) == len(named) else fit(_without(found.model, lost, found.base), known)
    drifts = temporal_drift(MODES, *mode_scores(extended, measured), measured.action, measured.turn, seed)
    floor = noise_floor(extended, test, seed) or noise_floor(extended, measured, seed)
    if floor and drifts:
        floor = floor.moved(-drifts.mse_of_repeats)
    base_losses, extended_losses = action_losses(base, test), action_losses(extended, test)

    def above_floor(missed: float) -> float:
        return max(missed - floor.mse, _SMALLEST_GAP * missed) if floor else missed

    above = above_floor(float(base_losses.mean()))
    chosen = {step.chosen: step for step in found.steps if step.chosen}

    def finding(model: Model, mechanism: Mechanism) -> Finding:
        left = action_losses(without(model, [mechanism.cause]), test)
        fall = (left - action_losses(model, test)) / above
        bounds = interval(fall[resamples(len(fall), _DRAWS, [seed, 12])].mean(1))
        step = chosen[mechanism.cause]
        return Finding(
            mechanism.cause, step.evidence[mechanism.cause].p_adjusted, confirmed_p[mechanism.cause],
            float(fall.mean()), bounds, values_with_errors(model, mechanism, known), step.rivals,
            of_what_is_left=float(fall.mean()) * above / above_floor(float(left.mean())),
            missed_without=float(left.mean()),
        )  # fmt: skip

    def findings(model: Model) -> tuple[Finding, ...]:
        return tuple(finding(model, m) for m in model.mechanisms if not isinstance(m, UnevenEnds))

    def without(model: Model, causes: Sequence[str]) -> Model:
        rest = _without(model, causes, base)
        return fit(rest, known) if any(m.cause in found.observable for m in rest.mechanisms) else base

    def is_misattributed(finding: Finding) -> bool:
        mechanism = found.observable[finding.cause]
        return (
            not shows_signature(mechanism, finding.values)
            or trails_by_another_power(mechanism, extended, known)
            or trails_both_ways(mechanism, extended, measured)
            or generic_curve_suffices(mechanism, extended, without(extended, [finding.cause]), known, test, seed)
        )

    established = findings(extended)
    # What is confirmed and of no use on strokes that nothing was fitted to goes, one by one: of two causes that can do
    # each other's work, neither is of use beside the other.
    while useless := [f for f in established if not _is_of_use(f, established, found, len(base_losses))]:
        worst = min(useless, key=lambda f: f.gain)
        extended = without(extended, [worst.cause])
        extended_losses = action_losses(extended, test)
        established = findings(extended)
    # Nor does what merely stands where something without a name belongs.
    misattributed = [f.cause for f in established if is_misattributed(f)]
    if misattributed:
        log(f"no better than what has no name: {', '.join(misattributed)}")
        extended = without(extended, misattributed)
        extended_losses = action_losses(extended, test)
        established = findings(extended)
    # What is established itself is no other explanation of its neighbour.
    names_of = {f.cause for f in established}
    established = tuple(replace(f, rivals=tuple(r for r in f.rivals if r not in names_of)) for f in established)
    doubtful = [m for m in named if m.cause not in {f.cause for f in established}]
    suspected = tuple(
        replace(finding(fit(extended.plus(m), known), m), misattributed=m.cause in misattributed) for m in doubtful
    )
    left, strength, names = unexplained(extended, known, covariates_shown(known), seed)
    worth = evaluate_modulator(extended, known, test, left, seed)
    left = [one._replace(generic_gain=worth.gain_of[one.mode, one.covariate]) for one in left]
    return Diagnosis(
        splits, measured, learned_residual, found, extended, base, established, suspected, floor, drifts, base_losses,
        extended_losses, tuple(left), strength, tuple(names),
    )  # fmt: skip


def _is_of_use(finding: Finding, established: Sequence[Finding], found: Search, test_split: int) -> bool:
    """Whether it surely acts, with a sign that it can have, and is worth enough on sealed strokes: surely something,
    where it is little, or little beside another, and the confirming strokes are not all but certain of it.

    A small table seals few strokes, which cannot tell little from nothing. Of the only cause that displaces the mark,
    or does not, which the confirming ones are sure of, few must only not deny it, and it must not be little beside one
    of the other kind.

    Args:
        sealed: actions.
    """
    its = found.observable[finding.cause]
    if any(not q.signed and finding.values[q.name][0] < 0 for q in its.quantities):
        return False
    if len(its.quantities) == 1:  # of several, each may be unsure where together they are not
        ((value, error),) = finding.values.values()
        if abs(value) < _SURELY_THERE * error:
            return False
    others = [f for f in established if f is not finding and can_mimic(found.observable[f.cause], its)]
    sure = finding.confirmed_p <= _SURE_P and not others and test_split <= _FEW
    if sure and len(established) == 1:
        return finding.gain > 0
    beyond_doubt = finding.confirmed_p <= _CERTAIN_P and finding.gain_interval[0] > 0
    minimum = _FAINT * _MIN_GAIN if beyond_doubt else _MIN_GAIN
    if (finding.of_what_is_left if beyond_doubt else finding.gain) < minimum:
        return False
    for f in others:  # forms leave little to what goes with nothing of theirs; that must be there beyond doubt
        may_be_left = form_error_share(found.observable[f.cause], its) if beyond_doubt else _MIN_BESIDE
        if finding.gain < f.gain * min(may_be_left, _MIN_BESIDE):
            return False
    if finding.confirmed_p <= _CERTAIN_P:
        return True
    largest = max(f.gain for f in established)
    good = _GOOD_GAIN * largest if sure else max(_GOOD_GAIN, _MIN_BESIDE * largest)
    return finding.gain >= good or finding.gain_interval[0] > 0


def _uneven_ends_for_lags(
    found: Search, discovery_split: Measured, measured: Measured, seed: int, log: Callable[[str], None]
) -> Search:
    """What was found, with uneven ends in the place of a cause by which a mark trails, where they do as much.

    A large one takes their place before other causes are known: what these do at a stroke's ends was in its favour.
    """
    for mechanism in found.model.mechanisms:
        if uneven_ends_suffice(mechanism, found.model, measured, seed):
            log(f"uneven ends do as much as {mechanism.cause}")
            base, model = (
                with_uneven_ends(m, discovery_split) for m in (found.base, found.model.without(mechanism.cause))
            )
            return replace(found, base=base, model=model)
    return found


def _without(model: Model, causes: Sequence[str], base: Model) -> Model:
    """The model less some causes, and with the base's ends where it had lost them to one of these: a cause must not
    be credited with what the base does without it.
    """
    rest = model.without(*causes)
    if not causes or any(isinstance(m, UnevenEnds) for m in rest.mechanisms):
        return rest
    return rest.plus(*(m for m in base.mechanisms if isinstance(m, UnevenEnds)))
