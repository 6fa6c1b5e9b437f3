"""Search for large effects, which must be found before the learned residual model can be fitted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import torch

from pentimento.diagnosis.score import Evidence, Step
from pentimento.diagnosis.strokes.candidates import (
    FIRST_P,
    LATER_P,
    backward_elimination,
    evaluate_candidates,
    is_far,
    is_large,
    is_physical,
    is_significant,
    refit_with,
    refits_with,
    shortlist,
    with_refit_evidence,
)  # fmt: skip
from pentimento.diagnosis.strokes.choice import choose, prune_unlikely
from pentimento.diagnosis.strokes.fit import fit
from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.model import Model, UnevenEnds, identity, observable_causes
from pentimento.diagnosis.strokes.predict import action_losses
from pentimento.diagnosis.strokes.search import MAX_CAUSES, Search
from pentimento.dynamics.strokes.simulation import Mechanism, StrokeContext

_LARGE_OF_MISFIT = 0.04
"""Share of the error above the noise floor that a large cause removes."""
_ALL_BUT = 0.95
"""Share of the effect of uneven ends that a cause must reach, with and without them, to replace them."""


def find_large(
    start: Model,
    measured: Measured,
    all_strokes: StrokeContext,
    *,
    noise_share: float,
    vocabulary: Sequence[type[Mechanism]],
    seed: int,
    log: Callable[[str], None],
) -> Search:
    """Extend the base, fitted from ``start``, by causes that explain a large part of the error.

    Args:
        start: a base.
        measured: the discovery split.
        all_strokes: context of all splits, in which a cause must be observable.
        noise_share: the noise floor as a share of the base's error; 0 if unknown.
        vocabulary: kinds of mechanisms.
        seed: of tests.
        log: gets one line a step.
    """
    plain = fit(start, measured)
    base = fit(plain.plus(identity(UnevenEnds, measured.context)), measured)
    observable, unseen = observable_causes(vocabulary, all_strokes)
    floor = noise_share * _loss(base, measured)
    found = Search(base, base, (), observable, unseen, floor, gained={}, large=frozenset())
    found = _without_uneven_ends(found, plain, measured, seed=seed, log=log)
    while len(found.steps) < MAX_CAUSES and (more := _with_one_more(found, measured, seed=seed, log=log)):
        found = more
    large = frozenset(m.cause for m in found.model.mechanisms if m.cause in observable and is_large(m))
    return replace(found, large=large)


def _loss(model: Model, measured: Measured) -> float:
    return float(action_losses(model, measured).mean())


def _without_uneven_ends(
    start: Search, plain: Model, measured: Measured, *, seed: int, log: Callable[[str], None]
) -> Search:
    """The search from a base without uneven ends, ``plain``, and a significant cause that replaces them; ``start`` if
    there is none.
    """
    instead = _replacing_uneven_ends(plain, start.base, start.floor, observable=start.observable, measured=measured)
    if not instead:
        return start
    evidence, _ = evaluate_candidates(plain, list(start.observable.values()), measured, seed=seed)
    instead = {cause: refit for cause, refit in instead.items() if is_significant(evidence[cause], FIRST_P)}
    if not instead:
        return start
    losses = {cause: action_losses(refit, measured) for cause, refit in instead.items()}
    before = _loss(plain, measured)
    step = choose(evidence, losses, before, refits=instead, measured=measured, seed=seed, log=log)
    assert step.chosen is not None
    gained = {step.chosen: before - float(losses[step.chosen].mean())}
    return replace(start, base=plain, model=instead[step.chosen], steps=(step,), gained=gained)


def _with_one_more(found: Search, measured: Measured, *, seed: int, log: Callable[[str], None]) -> Search | None:
    """The search with one more large cause; None if there is none."""
    model, observable = found.model, found.observable
    taken = {m.cause for m in model.mechanisms}
    candidates = [m for cause, m in observable.items() if cause not in taken]
    evidence, at_start = evaluate_candidates(model, candidates, measured, seed=seed + len(found.steps))
    short = shortlist(evidence, _limit(found), 1.0, observable=observable)
    refits = refits_with(model, short, observable, measured=measured, at_start=at_start)
    step = _large_step(found, refits, evidence, measured=measured, seed=seed, log=log)
    if step is None:
        refits = _far_refits(model, candidates, measured)
        step = _large_step(found, refits, evidence, measured=measured, seed=seed, log=log)
    if step is None:
        return None
    assert step.chosen is not None
    refit = refits[step.chosen]
    gained = found.gained | {step.chosen: _loss(model, measured) - _loss(refit, measured)}
    model = backward_elimination(refit, frozenset(), measured, seed=seed, log=log)
    return replace(found, model=model, steps=(*found.steps, step), gained=gained)


def _limit(found: Search) -> float:
    return LATER_P if found.steps else FIRST_P


def _replacing_uneven_ends(
    plain: Model, uneven: Model, floor: float, *, observable: Mapping[str, Mechanism], measured: Measured
) -> dict[str, Model]:
    """The base with each same-family cause in the place of the uneven ends, where one of these leaves them nothing to
    do.

    A lag is one quantity that explains where a mark ends; uneven ends are four, and hide it.
    """
    missed, at_best = _loss(plain, measured), _loss(uneven, measured)
    if missed - at_best < _LARGE_OF_MISFIT * (missed - floor):
        return {}
    family = [
        cause for cause, mechanism in observable.items() if mechanism.driving_covariate == UnevenEnds.driving_covariate
    ]
    instead = refits_with(plain, family, observable, measured=measured)
    removed = {cause: missed - _loss(refit, measured) for cause, refit in instead.items()}
    instead = {c: refit for c, refit in instead.items() if removed[c] >= _ALL_BUT * (missed - at_best)}
    ends = identity(UnevenEnds, measured.context)
    if any(
        removed[c] >= _ALL_BUT * (missed - _loss(fit(r.plus(ends), measured), measured)) for c, r in instead.items()
    ):
        return instead
    return {}


def _far_refits(model: Model, candidates: Sequence[Mechanism], measured: Measured) -> dict[str, Model]:
    """The model with each cause that displaces the mark by more than its half-width.

    Tests at 0 may show nothing of such an effect. It is fitted from its typical size.
    """

    def is_there(refit: Model) -> bool:
        return is_physical(refit.mechanisms[-1]) and is_far(refit, measured)

    refits = {}
    for mechanism in candidates:
        if mechanism.site == "trajectory" and not any(quantity.signed for quantity in mechanism.quantities):
            typical = torch.tensor([quantity.typical for quantity in mechanism.quantities], dtype=torch.float64)
            at_size = type(mechanism)(typical, mechanism.reference)
            # Most tools do not trail that far: a single fit without uneven ends rules it out.
            if not is_there(fit(model.without(UnevenEnds.cause).plus(at_size), measured)):
                continue
            refit = refit_with(model, at_size, measured)
            if is_there(refit):
                refits[mechanism.cause] = refit
    return refits


def _large_step(
    found: Search,
    refits: Mapping[str, Model],
    evidence: Mapping[str, Evidence],
    *,
    measured: Measured,
    seed: int,
    log: Callable[[str], None],
) -> Step | None:
    """The step to the best refit that removes a large part of the error and is large or far; or None."""
    limit = _limit(found)
    evidence = with_refit_evidence(evidence, refits, limit, model=found.model, measured=measured, seed=seed)
    error = _loss(found.model, measured)
    losses = {c: action_losses(refit, measured) for c, refit in refits.items() if is_significant(evidence[c], limit)}
    losses = {c: each for c, each in losses.items() if error - each.mean() >= _LARGE_OF_MISFIT * (error - found.floor)}
    if not losses:
        return None
    losses = prune_unlikely(losses, error, refits, measured)
    step = choose(evidence, losses, error, refits=refits, measured=measured, seed=seed, log=log)
    assert step.chosen is not None
    best = refits[step.chosen]
    return step if is_large(best.mechanisms[-1]) or is_far(best, measured) else None
