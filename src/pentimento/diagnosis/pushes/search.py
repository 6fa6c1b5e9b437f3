"""Forward selection of causes on pushes: score all, refit a shortlist, take the most parsimonious, relinearise, prune.

As for strokes (``diagnosis/strokes/search.py``), but without a separate search for large effects.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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

FIRST_P = 0.05
"""Score p below which a first candidate is refitted. Unconfirmed causes end as suspected."""
LATER_P = 0.03
"""The same beside a cause that was found."""
_ALIASABLE_P = 0.02
"""p of the fall of error that an aliasable cause needs."""
_SHORTLIST = 0.3
"""Fraction of the best gain above which a candidate is refitted as well."""
_MAX_REFITS = 4
_MIN_OF_FLOOR = 0.005
"""Minimum fall of error as a fraction of the noise floor."""
_MIN_IF_ALIASABLE = 0.0075
"""The same for an aliasable cause."""
_MIN_OF_MISFIT = 0.01
"""Minimum fall of error as a fraction of the error above the noise floor: in a base with many errors, some of the
residual always resembles a cause a little."""
_MIN_OF_MISFIT_BESIDE = 0.02
"""The same for an aliasable cause beside others: the forms of the causes that were found are inexact as well."""
_BESIDE = 0.01
"""Minimum fall of error beside a cause that was found, as a fraction of that cause's."""
_BESIDE_SAME_COVARIATE = 0.7
"""The same for a cause with that cause's driving covariate, which can take over its effect."""
_LEFT_BESIDE = 0.2
"""Minimum fall of error, as a fraction of what the cause removed when it was refitted in place of a cause that was
found. Of two effects, each keeps its own."""
_LEFT_BESIDE_ITS_RIVAL = 0.7
"""The same where it was that cause's rival. Of two explanations of one effect, the second removes little beside the
first."""
MAX_CAUSES = 6
_MAX_STEPS = 9


@dataclass(frozen=True)
class Search:
    """Result of a search."""

    base: AnalyticPush
    model: AnalyticPush
    steps: tuple[Step, ...]
    observable: dict[str, Mechanism]
    """Each observable cause, with all quantities at zero."""
    not_observable: dict[str, str]
    """Causes that these pushes cannot show, and the reason."""
    minimum: Mapping[str, float]
    """Minimum fall of error of each cause that was not found, beside those that were, mm²."""

    @property
    def found(self) -> frozenset[str]:
        """The causes of the model."""
        return frozenset(m.cause for m in self.model.mechanisms)


def observable_causes(
    measured: MeasuredPushes, vocabulary: Sequence[type[Mechanism]]
) -> tuple[dict[str, Mechanism], dict[str, str]]:
    """Observable causes, each with all quantities at zero; and those that are not observable, with the reason."""
    seen: dict[str, Mechanism] = {}
    unseen: dict[str, str] = {}
    for kind in vocabulary:
        try:
            seen[kind.cause] = identity(kind, measured.scene)
        except NotObservable as reason:
            unseen[kind.cause] = str(reason)
    return seen, unseen


@dataclass(frozen=True)
class _Thresholds:
    """Minimum fall of error of a cause, given what the search found so far."""

    observable: Mapping[str, Mechanism]
    floor: float
    """The noise floor, weighted like the errors, mm²; 0 where it is unknown."""
    gained: dict[str, float]
    """Fall of error by each cause that was found, mm²."""
    left: dict[str, float]
    """Minimum fall of error of a cause beside those in whose place it was refitted, mm²."""

    def minimum(self, cause: str, error: float) -> float:
        """In mm², where the model so far has this ``error``."""
        mechanism = self.observable[cause]
        of_floor = _MIN_IF_ALIASABLE if mechanism.aliasable else _MIN_OF_FLOOR
        of_misfit = _MIN_OF_MISFIT_BESIDE if mechanism.aliasable and self.gained else _MIN_OF_MISFIT
        minimum = max(of_floor * (self.floor or error), of_misfit * (error - self.floor), self.left.get(cause, 0.0))
        for found, gain in self.gained.items():
            same = self.observable[found].driving_covariate == mechanism.driving_covariate
            minimum = max(minimum, gain * (_BESIDE_SAME_COVARIATE if same else _BESIDE))
        return minimum

    def add(self, step: Step, falls: Mapping[str, float]) -> None:
        """Take the falls of error of a step's refits into account."""
        assert step.chosen is not None
        self.gained[step.chosen] = falls[step.chosen]
        for cause, fall in falls.items():
            share = _LEFT_BESIDE_ITS_RIVAL if cause in step.rivals else _LEFT_BESIDE
            self.left[cause] = max(self.left.get(cause, 0.0), share * fall)


def search(
    start: AnalyticPush,
    measured: MeasuredPushes,
    floor: float,
    vocabulary: Sequence[type[Mechanism]],
    *,
    seed: int,
    log: Callable[[str], None],
) -> Search:
    """Forward selection of causes: extend the base, fitted from ``start``, by the causes that the pushes support.

    Args:
        floor: the noise floor, weighted like the errors; 0 if it is unknown.
    """
    base = model = fit(start, measured)
    observable, unseen = observable_causes(measured, vocabulary)
    quantities = {cause: len(mechanism.quantities) for cause, mechanism in observable.items()}
    thresholds = _Thresholds(observable, floor, {}, {})
    steps: list[Step] = []
    evidence: dict[str, Evidence] = {}
    dismissed: set[str] = set()
    """Causes whose refit is unphysical or removes too little."""
    full = _linearised(model, observable, measured)
    while True:
        taken = {m.cause for m in model.mechanisms}
        own = np.arange(len(model.vector))
        columns = {cause: full.model.columns_of(cause) for cause in observable if cause not in taken | dismissed}
        fresh = _evidence(full.statistics, own, columns, measured, seed=seed + len(steps))
        evidence = {cause: e for cause, e in evidence.items() if cause in dismissed - taken} | fresh
        short = _shortlist(fresh, LATER_P if taken else FIRST_P)
        if not short or len(taken) == MAX_CAUSES or len(steps) == _MAX_STEPS:
            steps.append(Step(evidence, None, ()))
            break
        at_start = {cause: full.slopes.of(np.append(own, columns[cause])) for cause in short}
        refits = {cause: fit(model.plus(observable[cause]), measured, at_start[cause]) for cause in short}
        losses = {cause: action_losses(m, measured) for cause, m in refits.items() if m.mechanisms[-1].physical}
        before = action_losses(model, measured)
        error = float(before.mean())
        falls = {cause: float((before - after).mean()) for cause, after in losses.items()}
        losses = {
            cause: after
            for cause, after in losses.items()
            if falls[cause] >= thresholds.minimum(cause, error)
            and not could_be_the_base(observable[cause], before - after, seed)
        }
        dismissed |= set(short) - set(losses)
        if not losses:
            continue
        step = most_parsimonious(evidence, losses, error, quantities=quantities, seed=seed, log=log)
        steps.append(step)
        assert step.chosen is not None
        thresholds.add(step, {cause: falls[cause] for cause in losses})
        model = _pruned(refits[step.chosen], base, measured, seed=seed, log=log)
        full = _linearised(model, observable, measured)
    error = float(action_losses(model, measured).mean())
    others = set(observable) - {m.cause for m in model.mechanisms}
    minimum = {cause: thresholds.minimum(cause, error) for cause in others}
    return Search(base, model, tuple(steps), observable, unseen, minimum)


@dataclass(frozen=True)
class _Linearised:
    """A fitted model with all further observable causes at zero, linearised there."""

    model: AnalyticPush
    slopes: Slopes
    statistics: Statistics


def _linearised(model: AnalyticPush, observable: Mapping[str, Mechanism], measured: MeasuredPushes) -> _Linearised:
    taken = {m.cause for m in model.mechanisms}
    with_all = model.plus(*(m for cause, m in observable.items() if cause not in taken))
    slopes = slopes_of(with_all, measured)
    return _Linearised(with_all, slopes, slopes.statistics(with_all))


def _evidence(
    statistics: Statistics, own: Array, columns: Mapping[str, Array], measured: MeasuredPushes, *, seed: int
) -> dict[str, Evidence]:
    """Evidence for each candidate at a fitted model.

    Args:
        statistics: of the model with all candidates.
        own: indices of the model's own parameters, [P].
        columns: indices of the parameters of each candidate.
    """
    if not columns:
        return {}
    _, first = np.unique(measured.action, return_index=True)
    quantities = {cause: len(its) for cause, its in columns.items()}
    some = statistics.of(np.concatenate([own, *columns.values()]))
    return evidence_for(
        some, len(own), quantities, block=measured.block[first], seed=seed, scales=(information, scatter)
    )


def could_be_the_base(mechanism: Mechanism, falls: Array, seed: int) -> bool:
    """Whether the falls of error [actions] of an aliasable cause are not significant.

    A score test at zero may be sure of an effect that hardly improves any push; an inexact shape of the base can cause
    that as well.
    """
    return mechanism.aliasable and paired_p(falls, seed) >= _ALIASABLE_P


def _shortlist(evidence: Mapping[str, Evidence], limit: float) -> list[str]:
    """Candidates to refit: the one with the best gain among those with p below ``limit``, and those near to it."""
    significant = [cause for cause, e in evidence.items() if e.p_adjusted < limit and e.gain > 0]
    if not significant:
        return []
    best = max(significant, key=lambda cause: evidence[cause].gain)
    near = [cause for cause in significant if evidence[cause].gain > _SHORTLIST * evidence[best].gain]
    return sorted(near, key=lambda cause: -evidence[cause].gain)[:_MAX_REFITS]


def _pruned(
    model: AnalyticPush, base: AnalyticPush, measured: MeasuredPushes, *, seed: int, log: Callable[[str], None]
) -> AnalyticPush:
    """The model without mechanisms that its last one made redundant."""
    for mechanism in model.mechanisms[:-1]:
        refit = fit_without(model, mechanism.cause, base, measured)
        if paired_p(action_losses(refit, measured) - action_losses(model, measured), seed) > LATER_P:
            log(f"{mechanism.cause} is no longer needed")
            return _pruned(refit, base, measured, seed=seed, log=log)
    return model
