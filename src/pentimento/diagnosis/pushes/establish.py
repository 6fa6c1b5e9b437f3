"""Which causes of a search are established: confirmation, borderline candidates, misattribution checks, parsimony.

The test split confirms by scores, which are sensitive, and by errors, which are robust. Each check uses fixed
thresholds; ``decide`` applies them in order and reports the model that is left.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, combine_pvalues

from pentimento.diagnosis.evaluation import Floor
from pentimento.diagnosis.gauss_newton import covariance
from pentimento.diagnosis.pushes.fit import fit, fit_without
from pentimento.diagnosis.pushes.floor import floor_in_search
from pentimento.diagnosis.pushes.jacobian import action_losses, linearise
from pentimento.diagnosis.pushes.measured import MeasuredPushes, PushSplits
from pentimento.diagnosis.pushes.search import MAX_CAUSES, Search, could_be_the_base
from pentimento.diagnosis.score import Step, paired_p, projected_statistics, unconfirmed
from pentimento.diagnosis.verdict import Finding
from pentimento.dynamics.pushes.analytic import AnalyticPush, identity, typical
from pentimento.dynamics.pushes.mechanisms import LOOKALIKES, Mechanism
from pentimento.dynamics.pushes.mechanisms.mechanism import NotObservable

Array = NDArray[Any]

_CONFIRMED_BESIDE_P = 0.1
"""p on the test split at which a further cause counts as confirmed."""
_DENIED_P = 0.05
"""p on the test split at which a fall of error counts as a rise."""
_SURE_P = 0.01
"""p on the test split at which the scores alone count as sure of a cause."""
_CERTAIN_P = 0.001
"""The same on both splits together."""
_BORDERLINE_P = 0.35
"""Discovery p up to which a candidate is borderline. Beyond it, the test split would be the only evidence."""
_MAX_BORDERLINE = 2
"""Borderline candidates that are refitted."""
_TOGETHER_P = 0.003
"""Combined p that a borderline candidate needs."""
_MIN_GAIN = 0.01
"""Minimum fall of error on the test split, as a fraction of the gap and of the noise floor."""
_MIN_IF_ALIASABLE = 0.025
"""Minimum fall of error by a cause that an inexact base can look like, as a fraction of the noise floor."""
_MIN_IF_SURE = 0.0125
"""The same where the scores are sure of the cause."""
_MIN_OF_WHAT_IS_LEFT = 0.4
"""The same as a fraction of the error that certainly remains above the noise floor. Where much more error remains than
the cause removes, it is one of many errors of the base."""
_SURE_SE = 2.0
"""Standard errors at which the sign of a quantity is sure."""
_CERTAIN_SE = 4.0
"""Standard errors at which it is certain."""
_AS_GOOD = 0.95
"""Fraction of the cause's fall of error at which a look-alike is as good, if it is certainly worse."""
_NEARLY_AS_GOOD = 0.88
"""The same for a look-alike that is not certainly worse."""
_CERTAINLY_WORSE_P = 0.001
"""p at which a look-alike is certainly worse."""
_CERTAINLY_BY_PLACE_P = 0.001
"""p at which a cause certainly varies over the table."""


@dataclass(frozen=True)
class Decision:
    """What a search found, and which of it is established so far."""

    search: Search
    """With a borderline candidate that the test split settled."""
    model: AnalyticPush
    """With the causes that passed all checks."""
    confirmed_p: Mapping[str, float]
    """p of each found cause on the test split."""
    sure: frozenset[str]
    """Causes that scores are sure of: the errors of the test split must only not contradict them."""
    misattributed: frozenset[str]
    """Causes that stand in for an effect without a name."""


def decide(
    found: Search, weighted: MeasuredPushes, splits: PushSplits, seed: int, *, log: Callable[[str], None]
) -> Decision:
    """Decide which causes of a search are kept.

    Args:
        found: on the discovery split.
        weighted: all pushes, with fit weights and the learned residual.
    """
    discovery = weighted.pick(splits.discovery)
    test_actions = np.isin(np.unique(weighted.action), weighted.action[splits.test])
    settled = with_one_borderline(found, discovery, weighted, test_actions, seed=seed, log=log)
    confirmed_p = confirmations(settled.model, weighted, test_actions, seed)
    lost = unconfirmed([m.cause for m in settled.model.mechanisms], confirmed_p, _CONFIRMED_BESIDE_P)
    sure = _sure_causes(found, confirmed_p)
    noise = floor_in_search(settled.model, weighted, splits.discovery, seed)
    useful = _useful(
        settled.model.without(*lost), settled.base, discovery, weighted.pick(splits.test), noise=noise,
        confirmed_p=confirmed_p, sure=sure, seed=seed,
    )  # fmt: skip
    misattributed = _misattributed(useful, discovery, seed)
    return Decision(settled, useful.without(*misattributed), confirmed_p, frozenset(sure), frozenset(misattributed))


def confirmations(model: AnalyticPush, measured: MeasuredPushes, test_actions: Array, seed: int) -> dict[str, float]:
    """One-sided p of each cause on the test split: sign flips of the scores in the direction of its fitted effect.

    Args:
        model: fitted to the discovery split.
        measured: all pushes.
        test_actions: bool[n], which of their actions are in the test split.
    """
    if not model.mechanisms:
        return {}
    statistics, every = linearise(model, measured), np.arange(len(model.vector))
    confirmed = {}
    for mechanism in model.mechanisms:
        columns = model.columns_of(mechanism.cause)
        slope, curvature = projected_statistics(statistics, np.setdiff1d(every, columns), columns)
        values = model.vector[columns]
        support = slope @ values + np.einsum("p,npq,q->n", values, curvature, values)
        confirmed[mechanism.cause] = paired_p(support[test_actions], seed)
    return confirmed


def with_one_borderline(
    found: Search,
    discovery: MeasuredPushes,
    measured: MeasuredPushes,
    test_actions: Array,
    *,
    seed: int,
    log: Callable[[str], None],
) -> Search:
    """The search, with one borderline candidate added if both splits together support it (Fisher 1925).

    The candidate must also remove as much error of all pushes as a cause must.

    Args:
        measured, test_actions: as in ``confirmations``.
    """
    if len(found.found) == MAX_CAUSES:
        return found
    last = found.steps[-1]
    borderline = {
        c: e for c, e in last.evidence.items() if c in found.minimum and e.p_adjusted < _BORDERLINE_P and e.gain > 0
    }
    before = action_losses(found.model, measured)
    for cause in sorted(borderline, key=lambda cause: -borderline[cause].gain)[:_MAX_BORDERLINE]:
        mechanism = found.observable[cause]
        model = fit(found.model.plus(mechanism), discovery)
        falls = before - action_losses(model, measured)
        enough = model.mechanisms[-1].physical and falls.mean() >= found.minimum[cause]
        if not enough or could_be_the_base(mechanism, falls, seed):
            continue
        confirmed_p = confirmations(model, measured, test_actions, seed)[cause]
        together_p = float(combine_pvalues([borderline[cause].p_adjusted, confirmed_p], method="fisher").pvalue)
        if together_p < _TOGETHER_P:
            log(f"{cause}: borderline in the discovery split, supported with the test split (p {together_p:.2g})")
            evidence = {**last.evidence, cause: borderline[cause]._replace(p_adjusted=together_p)}
            return replace(found, model=model, steps=(*found.steps[:-1], Step(evidence, cause, ()), last))
    return found


def is_superfluous(
    finding: Finding, mechanism: Mechanism, gap: float, floor: Floor | None, *, losses: Array, sure: bool
) -> bool:
    """Whether the unweighted errors of the test split contradict a cause, or do not fall enough for an aliasable one.

    Args:
        gap: error of the base above the floor, of which the finding's gain is a fraction, mm².
        losses: of the extended model for each test action, mm².
        sure: whether scores are sure of the cause.
    """
    could_be_shape = _could_be_shape(mechanism, finding.values)
    if finding.gain < 0:
        # The few pushes with the largest errors dominate the fall: too little evidence against a certain cause.
        if _needs_certain_denial(could_be_shape, finding.confirmed_p):
            contradicted = finding.gain_interval[1] < 0
        else:
            contradicted = finding.confirmed_p > _CERTAIN_P
        if contradicted:
            return True
    if floor is None or not could_be_shape:
        return False
    left = float(losses.mean()) - floor.interval[1]
    minimum = max((_MIN_IF_SURE if sure else _MIN_IF_ALIASABLE) * floor.mse, _MIN_OF_WHAT_IS_LEFT * left)
    return finding.gain * gap < minimum


def values_with_errors(model: AnalyticPush, cause: str, measured: MeasuredPushes) -> dict[str, tuple[float, float]]:
    """Each quantity of a fitted mechanism with its cluster-robust standard error, in its unit, by name."""
    spread = np.diag(covariance(linearise(model, measured)))
    fitted = next(m for m in model.mechanisms if m.cause == cause)
    errors = np.sqrt(np.maximum(spread[model.columns_of(cause)], 0.0)) * typical(fitted)
    return {
        q.name: (float(value), float(error))
        for q, value, error in zip(fitted.quantities, fitted.values, errors, strict=True)
    }


def shows_signature(mechanism: Mechanism, values: Mapping[str, tuple[float, float]]) -> bool:
    """Whether a quantity that is essential for the cause is surely positive; True where none is.

    Args:
        values: each quantity with its standard error.
    """
    signed = [values[name] for name in mechanism.signature]
    return not signed or any(value > _SURE_SE * error for value, error in signed)


def depends_on_time(mechanism: Mechanism, values: Mapping[str, tuple[float, float]]) -> bool:
    """Whether the effect certainly depends on recorded times, as no shape of a base does."""
    shown = [values[name] for name in mechanism.signature] if mechanism.reference else []
    return any(value > _CERTAIN_SE * error for value, error in shown)


def varies_by_place(mechanism: Mechanism, values: Mapping[str, tuple[float, float]]) -> bool:
    """Whether the effect certainly varies over the table, as no shape of a base does; a chi-squared test."""
    squares = [(value / error) ** 2 for value, error in (values[name] for name in mechanism.by_place) if error > 0]
    return bool(squares) and bool(chi2.sf(sum(squares), len(squares)) < _CERTAINLY_BY_PLACE_P)


def lookalike_is_as_good(cause: str, model: AnalyticPush, discovery: MeasuredPushes, seed: int) -> bool:
    """Whether the look-alike of a cause explains its effect.

    The look-alike has one quantity where the cause has several, so it need not remove quite as much error, unless the
    cause is certainly better. Where the cause is right, the look-alike removes half to two thirds of what springback
    removes, two thirds to nine tenths of a far field, and a tenth to a half of a height offset with a gradient. Where
    the look-alike is right, it removes 95 % and more.

    Args:
        model: with the cause, fitted to ``discovery``.
    """
    if cause not in LOOKALIKES:
        return False
    try:
        other = identity(LOOKALIKES[cause], discovery.scene)
    except NotObservable:
        return False
    rest = fit(model.without(cause), discovery)
    error, with_cause, instead = (
        action_losses(each, discovery) for each in (rest, model, fit(rest.plus(other), discovery))
    )
    certainly_worse = paired_p(instead - with_cause, seed) < _CERTAINLY_WORSE_P
    as_good = _AS_GOOD if certainly_worse else _NEARLY_AS_GOOD
    return bool((error - instead).mean() >= as_good * (error - with_cause).mean())


def _useful(
    model: AnalyticPush,
    base: AnalyticPush,
    discovery: MeasuredPushes,
    test: MeasuredPushes,
    *,
    noise: float,
    confirmed_p: Mapping[str, float],
    sure: Collection[str],
    seed: int,
) -> AnalyticPush:
    """The model without causes that do not lower the weighted error of the test split, one at a time.

    Weights equalise the pushes; otherwise the few with the largest errors would decide. Of two aliased causes, neither
    is useful beside the other, so only one is dropped before the next fit.

    Args:
        noise: the noise floor, weighted like the errors, mm²; 0 where it is unknown.
        sure: causes that scores are sure of: their errors must only not contradict them.
    """
    if not model.mechanisms:
        return model
    base = fit(base, discovery)
    gap = float(action_losses(base, test).mean()) - noise
    while model.mechanisms:
        model = fit(model, discovery)
        losses, spare = action_losses(model, test), {}
        for m in model.mechanisms:
            falls = action_losses(fit_without(model, m.cause, base, discovery), test) - losses
            values = values_with_errors(model, m.cause, discovery) if m.signature or m.by_place else {}
            protected = _needs_certain_denial(_could_be_shape(m, values), confirmed_p[m.cause])
            if not protected or paired_p(-falls, seed) <= _DENIED_P:
                minimum = 0.0 if m.cause in sure else _MIN_GAIN * max(gap, noise)
                spare[m.cause] = float(falls.mean()) - minimum
        worst = min(spare, key=lambda cause: spare[cause], default=None)
        if worst is None or spare[worst] >= 0:
            break
        model = model.without(worst)
    return model


def _misattributed(model: AnalyticPush, discovery: MeasuredPushes, seed: int) -> list[str]:
    """Causes of a model, fitted to ``discovery``, that lack their signature or whose look-alike is as good."""
    return [
        m.cause
        for m in model.mechanisms
        if (m.signature and not shows_signature(m, values_with_errors(model, m.cause, discovery)))
        or lookalike_is_as_good(m.cause, model, discovery, seed)
    ]


def _could_be_shape(mechanism: Mechanism, values: Mapping[str, tuple[float, float]]) -> bool:
    """Whether a base with inexact shapes could be aliased with a cause of these values, each with its error."""
    return mechanism.aliasable and not depends_on_time(mechanism, values) and not varies_by_place(mechanism, values)


def _needs_certain_denial(could_be_shape: bool, confirmed_p: float) -> bool:
    """Whether only certainly rising errors drop a cause: no base shape is aliased with it, and scores confirm it.

    Test pushes are few, and their errors cannot distinguish a small effect from none.
    """
    return not could_be_shape and confirmed_p <= _CONFIRMED_BESIDE_P


def _sure_causes(found: Search, confirmed_p: Mapping[str, float]) -> set[str]:
    """Causes that the scores of the test split are sure of, or those of both splits together (Fisher 1925).

    The splits are independent: ``found`` is the search before a borderline candidate was added with the test split.
    """
    at_the_end = found.steps[-1].evidence
    p_discovery = {cause: evidence.p_adjusted for cause, evidence in at_the_end.items()}
    p_discovery |= {step.chosen: step.evidence[step.chosen].p_adjusted for step in found.steps if step.chosen}
    return {
        cause
        for cause, p in confirmed_p.items()
        if p <= _SURE_P or combine_pvalues([p_discovery[cause], p], method="fisher").pvalue <= _CERTAIN_P
    }
