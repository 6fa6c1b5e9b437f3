"""Forward selection of causes on pushes: test all, refit the few that stand out, take the best, relinearise, look back.

As on strokes (``diagnosis/strokes/search.py``), of large causes and small ones at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.gauss_newton import Statistics
from pentimento.diagnosis.pushes.fit import fit, fit_without
from pentimento.diagnosis.pushes.jacobian import Slopes, action_losses, slopes_of
from pentimento.diagnosis.pushes.measured import MeasuredPushes
from pentimento.diagnosis.score import Evidence, Step, evidence_for, information, most_parsimonious, paired_p, scatter
from pentimento.dynamics.pushes.analytic import AnalyticPush, identity
from pentimento.dynamics.pushes.mechanisms import Mechanism
from pentimento.dynamics.pushes.mechanisms.mechanism import NotObservable

Array = NDArray[Any]

FIRST_P, LATER_P = 0.05, 0.03
"""Of scores: who is worth a refit. What is not confirmed afterwards is told as suspected."""
_ALIASABLE_P = 0.02
"""Of the errors that a refit removes, where the base could look like the cause."""
_SHORTLIST = 0.3  # of the best gain
_MAX_REFITS = 4
_MIN_OF_FLOOR, _MIN_IF_ALIASABLE, _MIN_OF_MISFIT = 0.005, 0.0075, 0.01
"""Of the noise floor, and of the error above it: in a base that is wrong in many ways, something always looks a little
like a cause."""
_MIN_OF_MISFIT_BESIDE = 0.02
"""The same of a further cause that the base can look like: the forms of those that were found are not quite right
either."""
_BESIDE, _BESIDE_SAME_DRIVER = 0.01, 0.7
"""Of the largest gain so far: what a further cause must add; the second where it has the driver of one that was found,
and can do its work."""
_LEFT_BESIDE, _LEFT_BESIDE_ITS_RIVAL = 0.2, 0.7
"""Of what a cause removed in the place of one that was found: what must be left for it beside that. Of two explanations
of one thing, the second has little left to do; of two things, all."""
MAX_CAUSES = 6
_MAX_STEPS = 9


@dataclass(frozen=True)
class Search:
    """What came of it."""

    base: AnalyticPush
    model: AnalyticPush
    steps: tuple[Step, ...]
    observable: dict[str, Mechanism]
    """Each cause that these pushes can show, as it changes nothing yet."""
    not_observable: dict[str, str]
    """Causes that they cannot show, and why."""
    minimum: Mapping[str, float]
    """How much error each cause that was not found would have to remove beside those that were, mm²."""

    @property
    def found(self) -> frozenset[str]:
        """The causes of the model."""
        return frozenset(m.cause for m in self.model.mechanisms)


def observable_causes(
    measured: MeasuredPushes, vocabulary: Sequence[type[Mechanism]]
) -> tuple[dict[str, Mechanism], dict[str, str]]:
    """Causes that these pushes can show, each as it changes nothing yet; and those that they cannot, with why."""
    seen: dict[str, Mechanism] = {}
    unseen: dict[str, str] = {}
    for kind in vocabulary:
        try:
            seen[kind.cause] = identity(kind, measured.scene)
        except NotObservable as reason:
            unseen[kind.cause] = str(reason)
    return seen, unseen


def search(
    start: AnalyticPush,
    measured: MeasuredPushes,
    floor: float,
    vocabulary: Sequence[type[Mechanism]],
    seed: int,
    log: Callable[[str], None],
) -> Search:
    """Extend the base, fitted from ``start``, by the causes that the pushes speak for.

    Args:
        floor: the noise floor, weighted as errors are; 0 if it is unknown.
    """
    base = model = fit(start, measured)
    observable, unseen = observable_causes(measured, vocabulary)
    quantities = {cause: len(mechanism.quantities) for cause, mechanism in observable.items()}
    steps: list[Step] = []
    gained: dict[str, float] = {}
    left: dict[str, float] = {}
    """How much error a cause must remove beside those in whose place it was refitted, mm²."""
    evidence: dict[str, Evidence] = {}
    dismissed: set[str] = set()
    """Causes that would have to act as nothing does, or do too little."""
    with_all, slopes, statistics = _with_all(model, observable, measured)
    while True:
        taken = {m.cause for m in model.mechanisms}
        own = np.arange(len(model.vector))
        columns = {cause: with_all.columns_of(cause) for cause in observable if cause not in taken | dismissed}
        fresh = _weigh(statistics, own, columns, measured, seed + len(steps))
        evidence = {cause: e for cause, e in evidence.items() if cause in dismissed - taken} | fresh
        short = _shortlist(fresh, LATER_P if taken else FIRST_P)
        if not short or len(taken) == MAX_CAUSES or len(steps) == _MAX_STEPS:
            steps.append(Step(evidence, None, ()))
            break
        at_start = {cause: slopes.of(np.append(own, columns[cause])) for cause in short}
        refits = {cause: fit(model.plus(observable[cause]), measured, at_start[cause]) for cause in short}
        refits = {cause: refit for cause, refit in refits.items() if refit.mechanisms[-1].physical}
        dismissed |= set(short) - set(refits)
        before = action_losses(model, measured)
        error = float(before.mean())
        losses = {cause: action_losses(refit, measured) for cause, refit in refits.items()}
        size = {cause: float((before - after).mean()) for cause, after in losses.items()}
        minimum = _min_beside(refits, observable, gained, left, floor, error)
        mistaken = {
            c for c in refits if size[c] < minimum[c] or could_be_the_base(observable[c], before - losses[c], seed)
        }
        dismissed |= mistaken
        losses = {cause: after for cause, after in losses.items() if cause not in mistaken}
        if not losses:
            continue
        step = most_parsimonious(evidence, losses, error, quantities, seed, log)
        steps.append(step)
        assert step.chosen is not None
        gained[step.chosen] = size[step.chosen]
        for cause in losses:
            share = _LEFT_BESIDE_ITS_RIVAL if cause in step.rivals else _LEFT_BESIDE
            left[cause] = max(left.get(cause, 0.0), share * size[cause])
        model = _without_idle(refits[step.chosen], base, measured, seed, log)
        with_all, slopes, statistics = _with_all(model, observable, measured)
    others = set(observable) - {m.cause for m in model.mechanisms}
    error = float(action_losses(model, measured).mean())
    minimum = _min_beside(others, observable, gained, left, floor, error)
    return Search(base, model, tuple(steps), observable, unseen, minimum)


def _with_all(
    model: AnalyticPush, observable: Mapping[str, Mechanism], measured: MeasuredPushes
) -> tuple[AnalyticPush, Slopes, Statistics]:
    """A fitted model with all further causes that the pushes can show, its slopes and its statistics."""
    taken = {m.cause for m in model.mechanisms}
    with_all = model.plus(*(m for cause, m in observable.items() if cause not in taken))
    slopes = slopes_of(with_all, measured)
    return with_all, slopes, slopes.statistics(with_all)


def _weigh(
    statistics: Statistics, own: Array, columns: Mapping[str, Array], measured: MeasuredPushes, seed: int
) -> dict[str, Evidence]:
    """Evidence for each candidate at a fitted model.

    Args:
        statistics: of the model with all candidates.
        own: where the model's own numbers stand, [P].
        columns: where those of each candidate stand.
    """
    if not columns:
        return {}
    _, first = np.unique(measured.action, return_index=True)
    quantities = {cause: len(its) for cause, its in columns.items()}
    some = statistics.of(np.concatenate([own, *columns.values()]))
    return evidence_for(some, len(own), quantities, measured.block[first], seed, (information, scatter))


def _minimum(mechanism: Mechanism, beside_others: bool, floor: float, misfit: float) -> float:
    """How much error a cause must remove at least, mm², where that is ``misfit`` above the floor."""
    of_floor = _MIN_IF_ALIASABLE if mechanism.aliasable else _MIN_OF_FLOOR
    of_misfit = _MIN_OF_MISFIT_BESIDE if mechanism.aliasable and beside_others else _MIN_OF_MISFIT
    return max(of_floor * floor, of_misfit * misfit)


def could_be_the_base(mechanism: Mechanism, falls: Array, seed: int) -> bool:
    """Whether the errors that its refit removes, [actions], could as well be those of a base that is wrong about
    shapes: a score at no effect may be sure of what hardly makes a push better.
    """
    return mechanism.aliasable and paired_p(falls, seed) >= _ALIASABLE_P


def _shortlist(evidence: Mapping[str, Evidence], limit: float) -> list[str]:
    """Who is worth a refit: the best of those whose p is below ``limit``, and those near to it."""
    standing = [cause for cause, e in evidence.items() if e.p_adjusted < limit and e.gain > 0]
    if not standing:
        return []
    best = max(standing, key=lambda cause: evidence[cause].gain)
    near = [cause for cause in standing if evidence[cause].gain > _SHORTLIST * evidence[best].gain]
    return sorted(near, key=lambda cause: -evidence[cause].gain)[:_MAX_REFITS]


def _min_beside(
    causes: Iterable[str],
    observable: Mapping[str, Mechanism],
    gained: Mapping[str, float],
    left: Mapping[str, float],
    floor: float,
    error: float,
) -> dict[str, float]:
    """How much error each of some causes must remove at least, mm², beside those that ``gained`` what they did; of the
    floor 0 where it is unknown.
    """
    return {
        cause: max(
            _minimum(observable[cause], bool(gained), floor or error, error - floor),
            _enough(observable[cause], observable, gained, left),
        )
        for cause in causes
    }


def _enough(
    mechanism: Mechanism,
    observable: Mapping[str, Mechanism],
    gained: Mapping[str, float],
    left: Mapping[str, float],
) -> float:
    """How much error a further cause must remove, mm².

    A rival of what was found does its work, and what that one's form lacks.
    """
    minimum = left.get(mechanism.cause, 0.0)
    for found, gain in gained.items():
        alike = observable[found].driving_covariate == mechanism.driving_covariate
        minimum = max(minimum, gain * (_BESIDE_SAME_DRIVER if alike else _BESIDE))
    return minimum


def _without_idle(
    model: AnalyticPush, base: AnalyticPush, measured: MeasuredPushes, seed: int, log: Callable[[str], None]
) -> AnalyticPush:
    """The model less the mechanisms that it no longer needs, now that it has a new one."""
    for mechanism in model.mechanisms[:-1]:
        refit = fit_without(model, mechanism.cause, base, measured)
        if paired_p(action_losses(refit, measured) - action_losses(model, measured), seed) > LATER_P:
            log(f"{mechanism.cause} is no longer needed")
            return _without_idle(refit, base, measured, seed, log)
    return model
