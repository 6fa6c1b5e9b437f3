"""Choice among refitted candidate causes: parsimony, same-family causes, nested models, redundant rivals
(docs/diagnosis.md §5).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import torch
from numpy.typing import NDArray

from pentimento.diagnosis.residual_structure import find_structure
from pentimento.diagnosis.score import Evidence, Step, most_parsimonious
from pentimento.diagnosis.strokes.fit import values_with_errors
from pentimento.diagnosis.strokes.measured import Measured, covariates_shown
from pentimento.diagnosis.strokes.model import Model
from pentimento.diagnosis.strokes.modes import MODES, mode_scores
from pentimento.dynamics.strokes.simulation import Mechanism

Array = NDArray[Any]

_ALL_BUT = 0.99
"""Share of a larger cause's effect that a nested one must remove to be compared with it."""
_SURE = 4.5
"""Standard errors from which an extra quantity is certain."""
_MINOR = 0.5
"""A rival whose extra effect is surely below this share of the common effect is redundant."""
_DISPLACED = ("tangential", "normal")
"""Residual modes that tell apart causes that move a mark."""
_MIN_OF_BEST = 0.5
"""Share of the best cause's effect that a same-family cause must remove to replace it."""


def choose(
    evidence: dict[str, Evidence],
    losses: Mapping[str, Array],
    error: float,
    *,
    refits: Mapping[str, Model],
    measured: Measured,
    seed: int,
    log: Callable[[str], None],
) -> Step:
    """The step with the most parsimonious cause, after the same-family check and without redundant rivals.

    Args:
        evidence: of all candidates.
        losses: error of each action [n] with each refit.
        error: mean error before.
        refits: models with each cause as last mechanism.
        measured: strokes of the fits.
        seed: of tests.
        log: gets one line.
    """
    quantities = {cause: len(refits[cause].mechanisms[-1].quantities) for cause in losses}
    step = most_parsimonious(evidence, losses, error, quantities=quantities, seed=seed, log=log)
    return prune_redundant(
        prefer_same_family(step, losses, error, refits=refits, measured=measured, seed=seed, log=log), refits, measured
    )


def prefer_same_family(
    step: Step,
    losses: Mapping[str, Array],
    error: float,
    *,
    refits: Mapping[str, Model],
    measured: Measured,
    seed: int,
    log: Callable[[str], None],
) -> Step:
    """Replace the cause by one of its family that leaves less displacement over the covariates of only one of the two.

    Bristles trail by a length, a late arm by a time. Either shortens a mark, and which leaves less error depends on the
    base's profile. But for a mark that trails by a time, a length leaves a shift along the path that depends on speed.
    If errors cannot tell the two apart, the smaller remaining displacement decides. If they can, a significant
    displacement for only one of the two decides.
    """
    assert step.chosen is not None
    last = {cause: refits[cause].mechanisms[-1] for cause in losses}
    chosen, removed = step.chosen, {cause: error - float(each.mean()) for cause, each in losses.items()}
    for other in same_family(last[chosen], list(last.values())):
        columns = covariates_of_one_only(last[chosen], last[other], measured)
        if not columns or removed[other] < _MIN_OF_BEST * removed[chosen]:
            continue
        (own_is_sure, own), (its_is_sure, its) = (
            displacement_left(refits[cause], measured, columns, seed) for cause in (chosen, other)
        )
        told_apart = own_is_sure != its_is_sure
        if its < own and (other in step.rivals or (own_is_sure and not its_is_sure)):
            log(f"{other} and not {chosen}, which leaves a displacement by {', '.join(columns)}")
            rivals = [cause for cause in step.rivals if cause != other] + [chosen] * (not told_apart)
            return replace(step, chosen=other, rivals=tuple(rivals))
        if told_apart:
            step = replace(step, rivals=tuple(cause for cause in step.rivals if cause != other))
    return step


def same_family(mechanism: Mechanism, others: Sequence[Mechanism]) -> list[str]:
    """Causes with the same driving covariate and other informative covariates."""
    return [
        other.cause
        for other in others
        if other.driving_covariate == mechanism.driving_covariate
        and set(other.informative_covariates) != set(mechanism.informative_covariates)
    ]


def displacement_left(model: Model, measured: Measured, columns: Mapping[str, Array], seed: int) -> tuple[bool, float]:
    """Whether the residual's displacement significantly depends on one of the columns [B]; and the strength, |t|."""
    scores = mode_scores(model, measured)
    own = [MODES.index(mode) for mode in _DISPLACED]
    displaced = replace(scores, amounts=scores.amounts[:, own], energy=scores.energy[:, own])
    structure = find_structure(_DISPLACED, displaced, columns, action=measured.action, seed=seed)
    return bool(structure.unexplained), float(structure.strength.max())


def covariates_of_one_only(one: Mechanism, other: Mechanism, measured: Measured) -> dict[str, Array]:
    """Known covariates that only one of two causes depends on, [B] each."""
    shown = covariates_shown(measured)
    return {
        name: shown[name]
        for name in sorted(set(one.informative_covariates) ^ set(other.informative_covariates))
        if name in shown
    }


def prune_unlikely(
    losses: Mapping[str, Array], error: float, refits: Mapping[str, Model], measured: Measured
) -> dict[str, Array]:
    """Decide between nested causes, of which one has all quantities of the other and more.

    The smaller cause is dropped if an extra quantity is certain and matters to the error. The larger one is dropped
    instead if its certain quantities contradict what it is named for: then the extra quantity corrects the smaller
    cause's form. Example: ``speed_density`` does all that ``speed_bleed`` does and is paler.
    """
    last = {cause: refits[cause].mechanisms[-1] for cause in losses}
    names = {cause: {q.name for q in mechanism.quantities} for cause, mechanism in last.items()}
    out: set[str] = set()
    for cause in losses:
        enough = error - _ALL_BUT * (error - losses[cause].mean())
        within = {other for other in losses if names[other] < names[cause] and losses[other].mean() > enough}
        if not within:
            continue
        values = values_with_errors(refits[cause], last[cause], measured)
        sure = {name for name, (value, error) in values.items() if abs(value) > _SURE * error}
        told_apart = {other for other in within if sure - names[other]}
        if told_apart:
            surely = last[cause].values * torch.tensor([q.name in sure for q in last[cause].quantities])
            coherent = type(last[cause])(surely, last[cause].reference).coherent
            out |= told_apart if coherent else {cause}
    return {cause: each for cause, each in losses.items() if cause not in out}


def prune_redundant(step: Step, refits: Mapping[str, Model], measured: Measured) -> Step:
    """Drop rivals that contain the chosen cause's effect and whose additional effect is surely less than half of it.

    Example: ink that bleeds at speed spreads wider and softens the edge. If the edge surely stays, the mark is only
    wider.
    """
    assert step.chosen is not None
    own = _by_effect(refits[step.chosen])
    rivals = []
    for cause in step.rivals:
        sizes = {
            _effect(name): (abs(value), error)
            for name, (value, error) in _in_typical_sizes(refits[cause], measured).items()
        }
        more = [value + 2 * error for name, (value, error) in sizes.items() if name not in own]
        if not (own < set(sizes) and max(more) < _MINOR * max(sizes[name][0] for name in own)):
            rivals.append(cause)
    return replace(step, rivals=tuple(rivals))


def _by_effect(refit: Model) -> set[str]:
    return {_effect(q.name) for q in refit.mechanisms[-1].quantities}


def _effect(name: str) -> str:
    """The effect of a quantity on a mark: spreading makes it wider."""
    return name.replace("spreading", "width")


def _in_typical_sizes(refit: Model, measured: Measured) -> dict[str, tuple[float, float]]:
    """The last mechanism's quantities and standard errors in typical sizes, by name."""
    last = refit.mechanisms[-1]
    found, typical = values_with_errors(refit, last, measured), {q.name: q.typical for q in last.quantities}
    return {name: (value / typical[name], error / typical[name]) for name, (value, error) in found.items()}
