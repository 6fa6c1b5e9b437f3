"""Which of several causes to take, each refitted in the same place; the others may be its rivals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import torch
from numpy.typing import NDArray

from pentimento.diagnosis.residual_structure import structure
from pentimento.diagnosis.score import Evidence, Step, most_parsimonious
from pentimento.diagnosis.strokes.fit import values_with_errors
from pentimento.diagnosis.strokes.measured import Measured, covariates_shown
from pentimento.diagnosis.strokes.model import Model
from pentimento.diagnosis.strokes.modes import MODES, mode_scores
from pentimento.dynamics.strokes.simulation import Mechanism

Array = NDArray[Any]

_ALL_BUT = 0.99  # of what a cause removes that has more quantities
_SURE = 4.5  # standard errors of a quantity that one cause has beyond another
_MINOR = 0.5
_DISPLACED = ("tangential", "normal")
"""Modes that tell apart causes that move a mark."""
_MAX_OF_IT = 0.5
"""Of what the best one removes: what its kin must remove to take its place."""


def choose(
    evidence: dict[str, Evidence],
    losses: Mapping[str, Array],
    error: float,
    refits: Mapping[str, Model],
    measured: Measured,
    seed: int,
    log: Callable[[str], None],
) -> Step:
    """``most_parsimonious`` of refits, or its kin where that leaves less of what tells the two apart
    (``by_what_is_left``); without rivals that say the same (``prune_redundant``).
    """
    quantities = {cause: len(refits[cause].mechanisms[-1].quantities) for cause in losses}
    step = most_parsimonious(evidence, losses, error, quantities, seed, log)
    return prune_redundant(by_what_is_left(step, losses, error, refits, measured, seed, log), refits, measured)


def by_what_is_left(
    step: Step,
    losses: Mapping[str, Array],
    error: float,
    refits: Mapping[str, Model],
    measured: Measured,
    seed: int,
    log: Callable[[str], None],
) -> Step:
    """The step with its cause's kin in its place, where that leaves less displacement that goes with what only one of
    the two goes with.

    Bristles trail by a length, a late arm by a time. Either shortens a mark as well as the other, and which one leaves
    less error hangs on what the base's imprint lacks; but of a mark that trails by a time, a length leaves a shift
    along the path that goes with speed. Where errors do not tell the two apart, less of that decides; where they do,
    only that one surely leaves something and the other does not.
    """
    assert step.chosen is not None
    last = {cause: refits[cause].mechanisms[-1] for cause in losses}
    chosen, removed = step.chosen, {cause: error - float(each.mean()) for cause, each in losses.items()}
    for other in kin_of(last[chosen], list(last.values())):
        columns = told_by_one_of(last[chosen], last[other], measured)
        if not columns or removed[other] < _MAX_OF_IT * removed[chosen]:
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


def kin_of(mechanism: Mechanism, others: Sequence[Mechanism]) -> list[str]:
    """Causes of the same driver that go with something else."""
    return [
        other.cause
        for other in others
        if other.driving_covariate == mechanism.driving_covariate
        and set(other.informative_covariates) != set(mechanism.informative_covariates)
    ]


def displacement_left(model: Model, measured: Measured, columns: Mapping[str, Array], seed: int) -> tuple[bool, float]:
    """Whether what a model misses is surely displaced by an amount that goes with one of the columns [B]; and how
    strongly, as |t|.
    """
    scores, energy, error = mode_scores(model, measured)
    own = [MODES.index(mode) for mode in _DISPLACED]
    left, strength, _ = structure(_DISPLACED, scores[:, own], energy[:, own], error, columns, measured.action, seed)
    return bool(left), float(strength.max())


def told_by_one_of(one: Mechanism, other: Mechanism, measured: Measured) -> dict[str, Array]:
    """What was recorded and only one of two causes goes with, [B] each."""
    shown = covariates_shown(measured)
    return {
        name: shown[name]
        for name in sorted(set(one.informative_covariates) ^ set(other.informative_covariates))
        if name in shown
    }


def prune_unlikely(
    losses: Mapping[str, Array], error: float, refits: Mapping[str, Model], measured: Measured
) -> dict[str, Array]:
    """Of a cause and another that has all of its quantities and more, the right one, where what there is more is sure
    and removes more of the ``error`` than what a form that is not quite right lacks.

    Less paint at speed (``speed_density``) can do all that ``speed_bleed`` does, and is paler. If that is sure, it is
    named, but not where the rest surely contradicts it: then what is paler is a lack of the other's form.
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
    """The step without rivals that say the same as its cause: they can do all that it does, and do it, and what they
    can do beside that is surely less than half as much, each in its quantities' typical sizes.

    Ink that bleeds at speed is spread wider and has a soft edge. Where the edge surely stays as it is, the mark is
    wider, and that is all.
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
    """What a quantity does to a mark: one that spreads is wider."""
    return name.replace("spreading", "width")


def _in_typical_sizes(refit: Model, measured: Measured) -> dict[str, tuple[float, float]]:
    """The last mechanism's quantities with their standard errors, in typical sizes, by name."""
    last = refit.mechanisms[-1]
    found, typical = values_with_errors(refit, last, measured), {q.name: q.typical for q in last.quantities}
    return {name: (value / typical[name], error / typical[name]) for name, (value, error) in found.items()}
