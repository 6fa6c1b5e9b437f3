"""Forward selection of causes: test all, refit the few that stand out, take the best, relinearise, look back.

It goes on where the search for large causes (``large``) ended, with the tool's habits in what is foretold.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import combine_pvalues

from pentimento.diagnosis.score import Evidence, Step, paired_p, projected
from pentimento.diagnosis.strokes.candidates import (
    FIRST_P,
    LATER_P,
    held_out_losses,
    left_by_form,
    refits_with,
    shortlist,
    stands,
    weigh,
    with_that_of_refits,
    without_idle,
)
from pentimento.diagnosis.strokes.choice import choose, displacement_left, kin_of, prune_unlikely, told_by_one_of
from pentimento.diagnosis.strokes.fit import fit, held
from pentimento.diagnosis.strokes.jacobian import linearise
from pentimento.diagnosis.strokes.measured import Measured, covariates_shown
from pentimento.diagnosis.strokes.model import Model, UnevenEnds
from pentimento.diagnosis.strokes.predict import action_losses
from pentimento.dynamics.strokes.simulation import Mechanism

Array = NDArray[Any]

_KIN_P = 0.05
_MIN_OF_FLOOR, _MIN_OF_MISFIT = 0.01, 0.008
"""Of the noise floor, and of the error above it: in a base that is wrong in many ways, something always looks a little
like a cause."""
MAX_CAUSES, _MAX_STEPS = 6, 9
_BORDERLINE_P, _MAX_BORDERLINE = 0.35, 2
"""Beyond that p confirming strokes would be the only witness; of several in doubt, the first are refitted."""


@dataclass(frozen=True)
class Search:
    """What came of it."""

    base: Model
    model: Model
    steps: tuple[Step, ...]
    observable: dict[str, Mechanism]
    """Each cause that these strokes can show, as it changes nothing yet."""
    not_observable: dict[str, str]
    """Causes that they cannot show, and why."""
    floor: float
    """The noise floor, sRGB in [0, 1] squared; 0 if it is unknown."""
    gained: dict[str, float]
    """How much error each cause removed when it was found."""
    large: frozenset[str]
    """Those that were found first, by ``find_large``."""

    @property
    def found(self) -> frozenset[str]:
        """The causes of the model."""
        return frozenset(m.cause for m in self.model.mechanisms if m.cause in self.observable)


def search(begun: Search, measured: Measured, seed: int, log: Callable[[str], None]) -> Search:
    """Go on with what was begun, by ``find_large`` or by this, with the tool's habits in what is foretold."""
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
        fresh, at_start = weigh(model, candidates, measured, seed + len(steps))
        evidence = {cause: e for cause, e in evidence.items() if cause in dismissed - taken} | fresh
        limit = LATER_P if number else FIRST_P
        short = shortlist(fresh, limit, _KIN_P, observable)
        hidden = [] if short or not number else _hidden_by_ends(model, candidates, observable, measured, seed)
        short = short or hidden
        needless = {cause for cause in short if is_kin_of_what_suffices(cause, model, observable, measured, seed)}
        dismissed |= needless
        short = [cause for cause in short if cause not in needless]
        if not short or number == MAX_CAUSES or len(steps) == _MAX_STEPS:
            steps.append(Step(evidence, None, ()))
            break
        refits = refits_with(model, short, observable, measured, at_start)
        dismissed |= set(short) - set(refits)
        if hidden:
            fresh = with_that_of_refits(fresh, refits, limit, model, measured, seed)
            evidence |= fresh
        before = action_losses(model, measured)
        error = float(before.mean())
        losses = {cause: held_out_losses(refit, measured, seed) for cause, refit in refits.items()}
        size = {cause: float((before - each).mean()) for cause, each in losses.items()}
        so_far = replace(begun, gained=gained)
        small = {c for c in losses if size[c] < enough(observable[c], error, so_far)}
        dismissed |= small
        losses = {cause: after for cause, after in losses.items() if cause not in small}
        # From no effect a large one may look like little; what its refit removes is then the witness.
        removes_p = {cause: paired_p(before - after, seed) for cause, after in losses.items()}
        sure = {
            cause
            for cause in losses
            if stands(fresh[cause], limit) and (fresh[cause].min_gain > 0 or removes_p[cause] < LATER_P)
        }
        if not sure:  # what was tried for the sake of a cause that is dismissed is not enough by itself
            dismissed |= {cause for cause in losses if stands(fresh[cause], limit) or cause in hidden}
            continue
        losses = prune_unlikely(losses, error, refits, measured)
        step = choose(evidence, losses, error, refits, measured, seed, log)
        steps.append(step)
        assert step.chosen is not None
        gained[step.chosen] = size[step.chosen]
        model = without_idle(refits[step.chosen], begun.large, measured, seed, log)
    return replace(begun, model=model, steps=tuple(steps), gained=gained)


def settle(found: Search, measured: Measured, seed: int, log: Callable[[str], None]) -> Search:
    """What was found, with each cause and its rivals compared once more, beside all other causes of the model.

    When a cause was taken, what others do was still in the residual: with it, a rival may have looked as good or better
    (a latency beside a backlash that is not known yet, a lag). In the end the one that fits best stands there.
    """
    model, steps, gained = found.model, [], dict(found.gained)
    for step in found.steps:
        chosen, names = step.chosen, {m.cause for m in model.mechanisms}
        rivals = [rival for rival in step.rivals if rival not in names]
        if chosen is None or chosen not in names:
            steps.append(replace(step, rivals=tuple(rivals)))
            continue
        kin = kin_of(found.observable[chosen], list(found.observable.values()))
        rivals += [cause for cause in kin if cause not in [*names, *rivals]]
        if not rivals:
            steps.append(replace(step, rivals=()))
            continue
        without = fit(model.without(chosen), measured)
        now = next(m for m in model.mechanisms if m.cause == chosen)
        refits = {chosen: fit(model.without(chosen).plus(now), measured)}
        refits |= refits_with(without, rivals, found.observable, measured)
        losses = {cause: held_out_losses(refit, measured, seed) for cause, refit in refits.items()}
        error = float(action_losses(without, measured).mean())
        settled = choose(step.evidence, losses, error, refits, measured, seed, log)
        assert settled.chosen is not None
        steps.append(settled)
        if settled.chosen != chosen:
            model = refits[settled.chosen]
            gained[settled.chosen] = gained.pop(chosen)
    return replace(found, model=model, steps=tuple(steps), gained=gained)


def is_kin_of_what_suffices(
    cause: str, model: Model, observable: Mapping[str, Mechanism], measured: Measured, seed: int
) -> bool:
    """Whether the model has a cause of the same driver and is not sure to leave a displacement by what only one of the
    two goes with: where both act, either one alone leaves it.
    """
    taken = {m.cause: m for m in model.mechanisms if m.cause in observable}
    for kin in kin_of(observable[cause], list(taken.values())):
        columns = told_by_one_of(observable[cause], taken[kin], measured)
        if columns and not displacement_left(model, measured, columns, seed)[0]:
            return True
    return False


def _hidden_by_ends(
    model: Model, candidates: Sequence[Mechanism], observable: Mapping[str, Mechanism], measured: Measured, seed: int
) -> list[str]:
    """Candidates that uneven ends may hide and that what is left asks for: a displacement by what they go with and
    their kin does not. Ends are fitted to the average stroke, and every small step from no effect must undo them.
    """
    if not any(isinstance(m, UnevenEnds) for m in model.mechanisms):
        return []
    shown, asked_for = covariates_shown(measured), []
    for candidate in candidates:
        if candidate.driving_covariate == UnevenEnds.driving_covariate:
            of_kin = {
                name
                for kin in kin_of(candidate, list(observable.values()))
                for name in observable[kin].informative_covariates
            }
            own = {
                name: shown[name] for name in candidate.informative_covariates if name in shown and name not in of_kin
            }
            if own and of_kin and displacement_left(model, measured, own, seed)[0]:
                asked_for.append(candidate.cause)
    return asked_for


def enough(mechanism: Mechanism, error: float, so_far: Search) -> float:
    """How much error, sRGB, a further cause must remove of the ``error`` that is left: more than what a base that is
    wrong in many ways has of everything, and than what the forms of other causes may have left.
    """
    observable, floor = so_far.observable, so_far.floor
    left = [gain * left_by_form(observable[cause], mechanism) for cause, gain in so_far.gained.items()]
    return max(_MIN_OF_FLOOR * (floor or error), _MIN_OF_MISFIT * (error - floor), *left)


def confirmation(model: Model, cause: str, known: Measured, fresh: Array, seed: int) -> float:
    """One-sided p that strokes which were not searched do not ask for the cause, as it was found: sign flips of their
    scores in its direction (a difference of losses would have half the power).

    Args:
        model: with the cause, fitted to the searched strokes.
        known: those and the confirming ones.
        fresh: which of their actions are confirming ones, [n].
    """
    statistics = held(linearise(model, known), model)
    columns = model.columns_of(cause)
    rest = np.setdiff1d(np.arange(len(model.vector)), columns)
    slope, curvature = projected(statistics, rest, columns)
    values = model.vector[columns]
    return paired_p((slope @ values + np.einsum("p,npq,q->n", values, curvature, values))[fresh], seed)


def with_one_borderline(
    found: Search, discovery_split: Measured, known: Measured, fresh: Array, seed: int, log: Callable[[str], None]
) -> Search:
    """What was found, and beside it the cause that searched strokes speak for most without being sure, where together
    with the confirming strokes they are.

    Args:
        known, fresh: as of ``confirmation``.
    """
    last, limit = found.steps[-1], LATER_P if found.found else FIRST_P
    borderline = {
        cause: e.p_adjusted
        for cause, e in last.evidence.items()
        if cause not in found.found and not stands(e, limit) and e.gain > 0 and e.p_adjusted < _BORDERLINE_P
    }
    if not borderline or len(found.found) == MAX_CAUSES:
        return found
    tried = [
        cause
        for cause in sorted(borderline, key=lambda cause: borderline[cause])[:_MAX_BORDERLINE]
        if not is_kin_of_what_suffices(cause, found.model, found.observable, discovery_split, seed)
    ]
    refits = refits_with(found.model, tried, found.observable, discovery_split)
    before = action_losses(found.model, discovery_split)
    error = float(before.mean())
    losses = {cause: held_out_losses(refit, discovery_split, seed) for cause, refit in refits.items()}
    size = {cause: float((before - each).mean()) for cause, each in losses.items()}
    losses = {c: each for c, each in losses.items() if size[c] >= enough(found.observable[c], error, found)}
    if not losses:
        return found
    step = choose(last.evidence, losses, error, refits, discovery_split, seed, lambda _: None)
    cause = step.chosen
    assert cause is not None
    confirmed_p = confirmation(refits[cause], cause, known, fresh, seed)
    together_p = float(combine_pvalues([last.evidence[cause].p_adjusted, confirmed_p], method="fisher").pvalue)
    if together_p >= limit:
        return found
    log(f"{cause}: in doubt, and not with the confirming strokes (p {together_p:.2g})")
    evidence = {**last.evidence, cause: last.evidence[cause]._replace(p_adjusted=together_p)}
    return replace(
        found,
        model=refits[cause],
        steps=(*found.steps[:-1], replace(step, evidence=evidence), last),
        gained={**found.gained, cause: size[cause]},
    )
