"""Forward selection of causes on the discovery split, and the one borderline cause that the confirmation split may add.

It continues from the search for large effects (``large_effects``), with the learned residual model in the predictions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import combine_pvalues

from pentimento.diagnosis.score import Evidence, Step, paired_p, projected_statistics
from pentimento.diagnosis.strokes.candidates import (
    FIRST_P,
    LATER_P,
    backward_elimination,
    evaluate_candidates,
    form_error_share,
    held_out_losses,
    is_significant,
    refits_with,
    shortlist,
    with_refit_evidence,
)
from pentimento.diagnosis.strokes.choice import (
    choose,
    covariates_of_one_only,
    displacement_left,
    prune_unlikely,
    same_family,
)
from pentimento.diagnosis.strokes.fit import fit, with_prior
from pentimento.diagnosis.strokes.jacobian import linearise
from pentimento.diagnosis.strokes.measured import Measured, covariates_shown
from pentimento.diagnosis.strokes.model import Model, UnevenEnds
from pentimento.diagnosis.strokes.predict import action_losses
from pentimento.dynamics.strokes.simulation import Mechanism

Array = NDArray[Any]

_FAMILY_P = 0.05
"""p up to which causes at the best one's site are refitted too."""
_MIN_OF_FLOOR = 0.01
"""Minimum error that a cause must remove, as a share of the noise floor."""
_MIN_OF_MISFIT = 0.008
"""The same as a share of the error above the floor. In a base that is wrong in many ways, something always resembles a
cause."""
MAX_CAUSES = 6
_MAX_STEPS = 9
_BORDERLINE_P = 0.35
"""Discovery p of a borderline candidate, at most."""
_MAX_BORDERLINE = 2
"""Borderline candidates that are refitted."""


@dataclass(frozen=True)
class Search:
    """State of the selection."""

    base: Model
    model: Model
    steps: tuple[Step, ...]
    observable: dict[str, Mechanism]
    """Mechanism of each cause that these strokes can show, with all quantities 0."""
    not_observable: dict[str, str]
    """Causes that they cannot show, and why."""
    floor: float
    """The noise floor, sRGB in [0, 1] squared; 0 if unknown."""
    gained: dict[str, float]
    """Error that each cause removed when it was accepted."""
    large: frozenset[str]
    """Causes accepted by ``find_large``."""

    @property
    def found(self) -> frozenset[str]:
        """The causes of the model."""
        return frozenset(m.cause for m in self.model.mechanisms if m.cause in self.observable)


def search(begun: Search, measured: Measured, seed: int, log: Callable[[str], None]) -> Search:
    """Continue the search of ``find_large`` with the learned residual model in the predictions."""
    model = fit(begun.model, measured)
    observable = begun.observable
    steps = [step for step in begun.steps if step.chosen]
    gained = dict(begun.gained)
    evidence: dict[str, Evidence] = {}
    dismissed: set[str] = set()
    """Causes that would have to act with the wrong sign, or do too little."""
    while True:
        number = sum(m.cause in observable for m in model.mechanisms)
        taken = {m.cause for m in model.mechanisms}
        candidates = [m for cause, m in observable.items() if cause not in taken | dismissed]
        fresh, at_start = evaluate_candidates(model, candidates, measured, seed=seed + len(steps))
        evidence = {cause: e for cause, e in evidence.items() if cause in dismissed - taken} | fresh
        limit = LATER_P if number else FIRST_P
        short = shortlist(fresh, limit, _FAMILY_P, observable=observable)
        hidden = (
            [] if short or not number else _hidden_by_ends(model, candidates, observable, measured=measured, seed=seed)
        )
        short = short or hidden
        needless = {
            cause for cause in short if same_family_suffices(cause, model, observable, measured=measured, seed=seed)
        }
        dismissed |= needless
        short = [cause for cause in short if cause not in needless]
        if not short or number == MAX_CAUSES or len(steps) == _MAX_STEPS:
            steps.append(Step(evidence, None, ()))
            break
        refits = refits_with(model, short, observable, measured=measured, at_start=at_start)
        dismissed |= set(short) - set(refits)
        if hidden:
            fresh = with_refit_evidence(fresh, refits, limit, model=model, measured=measured, seed=seed)
            evidence |= fresh
        before = action_losses(model, measured)
        error = float(before.mean())
        losses = {cause: held_out_losses(refit, measured, seed) for cause, refit in refits.items()}
        size = {cause: float((before - each).mean()) for cause, each in losses.items()}
        so_far = replace(begun, gained=gained)
        small = {c for c in losses if size[c] < min_removed(observable[c], error, so_far)}
        dismissed |= small
        losses = {cause: after for cause, after in losses.items() if cause not in small}
        # From no effect a large one may look like little; what its refit removes is then the witness.
        removes_p = {cause: paired_p(before - after, seed) for cause, after in losses.items()}
        sure = {
            cause
            for cause in losses
            if is_significant(fresh[cause], limit) and (fresh[cause].min_gain > 0 or removes_p[cause] < LATER_P)
        }
        if not sure:  # what was tried for the sake of a cause that is dismissed is not enough by itself
            dismissed |= {cause for cause in losses if is_significant(fresh[cause], limit) or cause in hidden}
            continue
        losses = prune_unlikely(losses, error, refits, measured)
        step = choose(evidence, losses, error, refits=refits, measured=measured, seed=seed, log=log)
        steps.append(step)
        assert step.chosen is not None
        gained[step.chosen] = size[step.chosen]
        model = backward_elimination(refits[step.chosen], begun.large, measured, seed=seed, log=log)
    return replace(begun, model=model, steps=tuple(steps), gained=gained)


def recheck_alternatives(found: Search, measured: Measured, seed: int, log: Callable[[str], None]) -> Search:
    """Compare each accepted cause with its rivals once more, beside all other causes of the model.

    When a cause was accepted, the effects of later ones were still in the residual, so a rival may have looked as good
    or better. The one that fits best in the end is kept.
    """
    model, steps, gained = found.model, [], dict(found.gained)
    for step in found.steps:
        chosen, names = step.chosen, {m.cause for m in model.mechanisms}
        rivals = [rival for rival in step.rivals if rival not in names]
        if chosen is None or chosen not in names:
            steps.append(replace(step, rivals=tuple(rivals)))
            continue
        relative = same_family(found.observable[chosen], list(found.observable.values()))
        rivals += [cause for cause in relative if cause not in [*names, *rivals]]
        if not rivals:
            steps.append(replace(step, rivals=()))
            continue
        without = fit(model.without(chosen), measured)
        now = next(m for m in model.mechanisms if m.cause == chosen)
        refits = {chosen: fit(model.without(chosen).plus(now), measured)}
        refits |= refits_with(without, rivals, found.observable, measured=measured)
        losses = {cause: held_out_losses(refit, measured, seed) for cause, refit in refits.items()}
        error = float(action_losses(without, measured).mean())
        settled = choose(step.evidence, losses, error, refits=refits, measured=measured, seed=seed, log=log)
        assert settled.chosen is not None
        steps.append(settled)
        if settled.chosen != chosen:
            model = refits[settled.chosen]
            gained[settled.chosen] = gained.pop(chosen)
    return replace(found, model=model, steps=tuple(steps), gained=gained)


def same_family_suffices(
    cause: str, model: Model, observable: Mapping[str, Mechanism], *, measured: Measured, seed: int
) -> bool:
    """Whether the model has a same-family cause and leaves no significant displacement that would need this one as
    well.
    """
    taken = {m.cause: m for m in model.mechanisms if m.cause in observable}
    for relative in same_family(observable[cause], list(taken.values())):
        columns = covariates_of_one_only(observable[cause], taken[relative], measured)
        if columns and not displacement_left(model, measured, columns, seed)[0]:
            return True
    return False


def _hidden_by_ends(
    model: Model, candidates: Sequence[Mechanism], observable: Mapping[str, Mechanism], *, measured: Measured, seed: int
) -> list[str]:
    """Candidates that uneven ends may hide: the residual is displaced by covariates that only the candidate depends on.

    Ends are fitted to the average stroke, and a small step of the candidate from 0 would have to undo them.
    """
    if not any(isinstance(m, UnevenEnds) for m in model.mechanisms):
        return []
    shown, asked_for = covariates_shown(measured), []
    for candidate in candidates:
        if candidate.driving_covariate == UnevenEnds.driving_covariate:
            of_family = {
                name
                for relative in same_family(candidate, list(observable.values()))
                for name in observable[relative].informative_covariates
            }
            own = {
                name: shown[name]
                for name in candidate.informative_covariates
                if name in shown and name not in of_family
            }
            if own and of_family and displacement_left(model, measured, own, seed)[0]:
                asked_for.append(candidate.cause)
    return asked_for


def min_removed(mechanism: Mechanism, error: float, so_far: Search) -> float:
    """The minimum error, sRGB, that a further cause must remove from ``error``: more than a wrong base leaves of
    anything, and more than the inexact forms of accepted causes leave.
    """
    observable, floor = so_far.observable, so_far.floor
    left = [gain * form_error_share(observable[cause], mechanism) for cause, gain in so_far.gained.items()]
    return max(_MIN_OF_FLOOR * (floor or error), _MIN_OF_MISFIT * (error - floor), *left)


def confirmation_p(model: Model, cause: str, known: Measured, *, fresh: Array, seed: int) -> float:
    """One-sided p of the confirmation split against a cause with its values from the discovery split: sign flips of its
    scores, which have twice the power of a difference of losses.

    Args:
        model: with the cause, fitted to the discovery split.
        cause: its name.
        known: discovery and confirmation split.
        fresh: which of its actions are in the confirmation split, bool[n].
        seed: of the sign flips.
    """
    statistics = with_prior(linearise(model, known), model)
    columns = model.columns_of(cause)
    rest = np.setdiff1d(np.arange(len(model.vector)), columns)
    slope, curvature = projected_statistics(statistics, rest, columns)
    values = model.vector[columns]
    return paired_p((slope @ values + np.einsum("p,npq,q->n", values, curvature, values))[fresh], seed)


def accept_borderline(
    found: Search, discovery_split: Measured, known: Measured, *, fresh: Array, seed: int, log: Callable[[str], None]
) -> Search:
    """Accept the best borderline candidate if discovery and confirmation split together support it.

    The two splits are independent, so their p are combined by Fisher's method (1925).

    Args:
        known: as for ``confirmation_p``.
        fresh: likewise.
    """
    last, limit = found.steps[-1], LATER_P if found.found else FIRST_P
    borderline = {
        cause: e.p_adjusted
        for cause, e in last.evidence.items()
        if cause not in found.found and not is_significant(e, limit) and e.gain > 0 and e.p_adjusted < _BORDERLINE_P
    }
    if not borderline or len(found.found) == MAX_CAUSES:
        return found
    tried = [
        cause
        for cause in sorted(borderline, key=lambda cause: borderline[cause])[:_MAX_BORDERLINE]
        if not same_family_suffices(cause, found.model, found.observable, measured=discovery_split, seed=seed)
    ]
    refits = refits_with(found.model, tried, found.observable, measured=discovery_split)
    before = action_losses(found.model, discovery_split)
    error = float(before.mean())
    losses = {cause: held_out_losses(refit, discovery_split, seed) for cause, refit in refits.items()}
    size = {cause: float((before - each).mean()) for cause, each in losses.items()}
    losses = {c: each for c, each in losses.items() if size[c] >= min_removed(found.observable[c], error, found)}
    if not losses:
        return found
    step = choose(last.evidence, losses, error, refits=refits, measured=discovery_split, seed=seed, log=lambda _: None)
    cause = step.chosen
    assert cause is not None
    confirmed_p = confirmation_p(refits[cause], cause, known, fresh=fresh, seed=seed)
    together_p = float(combine_pvalues([last.evidence[cause].p_adjusted, confirmed_p], method="fisher").pvalue)
    if together_p >= limit:
        return found
    log(f"{cause}: borderline, and significant with the confirmation split (p {together_p:.2g})")
    evidence = {**last.evidence, cause: last.evidence[cause]._replace(p_adjusted=together_p)}
    return replace(
        found,
        model=refits[cause],
        steps=(*found.steps[:-1], replace(step, evidence=evidence), last),
        gained={**found.gained, cause: size[cause]},
    )
