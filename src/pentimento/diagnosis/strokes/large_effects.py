"""Search for large effects, which must be found before the learned residual model can be fitted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

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
from pentimento.diagnosis.strokes.model import Model, UnevenEnds, identity
from pentimento.diagnosis.strokes.predict import action_losses
from pentimento.diagnosis.strokes.search import MAX_CAUSES, Search
from pentimento.dynamics.strokes.simulation import Mechanism, NotObservable, StrokeContext

_LARGE_OF_MISFIT = 0.04
"""Share of the error above the noise floor that a large cause removes."""
_ALL_BUT = 0.95
"""Share of the effect of uneven ends that a cause must reach, with and without them, to replace them."""


def find_large(
    start: Model,
    measured: Measured,
    all_strokes: StrokeContext,
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
    base = model = fit(plain.plus(identity(UnevenEnds, measured.context)), measured)
    error = float(action_losses(base, measured).mean())
    floor = noise_share * error
    observable: dict[str, Mechanism] = {}
    unseen: dict[str, str] = {}
    for kind in vocabulary:
        try:
            observable[kind.cause] = identity(kind, all_strokes)
        except NotObservable as reason:
            unseen[kind.cause] = str(reason)
    steps: list[Step] = []
    gained: dict[str, float] = {}
    instead = _replacing_uneven_ends(plain, base, floor, observable, measured)
    evidence = evaluate_candidates(plain, list(observable.values()), measured, seed)[0] if instead else {}
    instead = {cause: refit for cause, refit in instead.items() if is_significant(evidence[cause], FIRST_P)}
    if instead:
        losses = {cause: action_losses(refit, measured) for cause, refit in instead.items()}
        before = float(action_losses(plain, measured).mean())
        step = choose(evidence, losses, before, instead, measured, seed, log)
        assert step.chosen is not None
        steps.append(step)
        base, model = plain, instead[step.chosen]
        error = float(losses[step.chosen].mean())
        gained[step.chosen] = before - error
    while len(steps) < MAX_CAUSES:
        taken = {m.cause for m in model.mechanisms}
        candidates = [m for cause, m in observable.items() if cause not in taken]
        evidence, at_start = evaluate_candidates(model, candidates, measured, seed + len(steps))
        limit = LATER_P if steps else FIRST_P
        short = shortlist(evidence, limit, 1.0, observable)
        found = _large_step(
            model,
            refits_with(model, short, observable, measured, at_start),
            evidence,
            limit,
            floor,
            measured,
            seed,
            log,
        ) or _large_step(model, _far_refits(model, candidates, measured), evidence, limit, floor, measured, seed, log)
        if found is None:
            break
        step, refit = found
        assert step.chosen is not None
        steps.append(step)
        gained[step.chosen] = error - float(action_losses(refit, measured).mean())
        model = backward_elimination(refit, frozenset(), measured, seed, log)
        error = float(action_losses(model, measured).mean())
    large = frozenset(m.cause for m in model.mechanisms if m.cause in observable and is_large(m))
    return Search(base, model, tuple(steps), observable, unseen, floor, gained, large)


def _replacing_uneven_ends(
    plain: Model, uneven: Model, floor: float, observable: Mapping[str, Mechanism], measured: Measured
) -> dict[str, Model]:
    """The base with each same-family cause in the place of the uneven ends, where one of these leaves them nothing to
    do.

    A lag is one quantity that explains where a mark ends; uneven ends are four, and hide it.
    """

    def left(model: Model) -> float:
        return float(action_losses(model, measured).mean())

    missed, at_best = left(plain), left(uneven)
    if missed - at_best < _LARGE_OF_MISFIT * (missed - floor):
        return {}
    family = [
        cause for cause, mechanism in observable.items() if mechanism.driving_covariate == UnevenEnds.driving_covariate
    ]
    instead = refits_with(plain, family, observable, measured)
    removed = {cause: missed - left(refit) for cause, refit in instead.items()}
    instead = {c: refit for c, refit in instead.items() if removed[c] >= _ALL_BUT * (missed - at_best)}
    ends = identity(UnevenEnds, measured.context)
    if any(removed[c] >= _ALL_BUT * (missed - left(fit(r.plus(ends), measured))) for c, r in instead.items()):
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
    model: Model,
    refits: Mapping[str, Model],
    evidence: Mapping[str, Evidence],
    limit: float,
    floor: float,
    measured: Measured,
    seed: int,
    log: Callable[[str], None],
) -> tuple[Step, Model] | None:
    """The step to the best refit that removes a large part of the error and is large or far, with it; or None."""
    evidence = with_refit_evidence(evidence, refits, limit, model, measured, seed)
    error = float(action_losses(model, measured).mean())
    losses = {c: action_losses(refit, measured) for c, refit in refits.items() if is_significant(evidence[c], limit)}
    losses = {c: each for c, each in losses.items() if error - each.mean() >= _LARGE_OF_MISFIT * (error - floor)}
    if not losses:
        return None
    losses = prune_unlikely(losses, error, refits, measured)
    step = choose(evidence, losses, error, refits, measured, seed, log)
    assert step.chosen is not None
    best = refits[step.chosen]
    return (step, best) if is_large(best.mechanisms[-1]) or is_far(best, measured) else None
