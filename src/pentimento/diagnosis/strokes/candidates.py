"""Evidence for a candidate cause: tests at the model without it, refits with it, and the backward step."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.gauss_newton import Statistics
from pentimento.diagnosis.score import (
    RESAMPLES,
    Evidence,
    evidence_for,
    held_out_gains,
    mean_over_actions,
    paired_p,
    statistics_with_each,
)
from pentimento.diagnosis.strokes.fit import fit, stiffened, with_prior
from pentimento.diagnosis.strokes.jacobian import linearise
from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.model import Model, UnevenEnds
from pentimento.diagnosis.strokes.predict import action_losses, mark_px
from pentimento.dynamics.strokes.mechanisms.lens_distortion import LensDistortion
from pentimento.dynamics.strokes.simulation import Mechanism

Array = NDArray[Any]

FIRST_P = 0.02
"""Limit of the adjusted p in the first round (docs/diagnosis.md §5)."""
LATER_P = 0.01
"""Limit of the adjusted p in later rounds."""
_KEEP_P = 0.05
"""A cause of the model stays if dropping it is worse at this level; uneven ends need the level of a new cause."""
_SHORTLIST = 0.4
"""Share of the best gain that a candidate needs for a refit."""
_MAX_REFITS = 4
"""Refitted candidates with a good gain."""
_MAX_FAMILY = 2
"""Further refitted candidates at the best one's site."""
_LARGE = 2.0
"""Multiple of the typical size from which an effect is large."""
_LEFT = 0.05
"""Share of a cause's effect that its inexact functional form may leave for another cause."""
_LEFT_TO_SAME_FAMILY = 0.1
"""The same for another cause of its family."""
_LEFT_TO_UNRELATED = 0.01
"""The same for a cause with other covariates."""
_MIN_ABSORBED = -0.5
"""Lower bound of a lens's linear displacement at the strokes' edge, which rectification absorbs, relative to its cubic
one."""
_MAX_ABSORBED = 3.0
"""Upper bound of the same. A purely linear displacement is a wrong scale and no lens."""


def evaluate_candidates(
    model: Model, candidates: Sequence[Mechanism], measured: Measured, *, seed: int
) -> tuple[dict[str, Evidence], dict[str, Statistics]]:
    """Evidence for each candidate at a fitted model, and the statistics of the model with it."""
    if not candidates:
        return {}, {}
    full = model.plus(*candidates)
    statistics = linearise(full, measured)
    # The prior's curvature keeps the nuisances from compensating a cause by implausible steps. Its gradient is left
    # out, because it would bias causes that overlap with the base.
    stiff = stiffened(statistics, full, 1.0)
    _, first = np.unique(measured.action, return_index=True)
    quantities = {mechanism.cause: len(mechanism.quantities) for mechanism in candidates}
    size = len(model.vector)
    return evidence_for(stiff, size, quantities, block=measured.block[first], seed=seed), statistics_with_each(
        statistics, size, quantities
    )


def is_significant(evidence: Evidence, limit: float) -> bool:
    """Whether the test supports the cause and its held-out gain is positive."""
    return evidence.p_adjusted < limit and evidence.gain > 0


def shortlist(
    evidence: Mapping[str, Evidence], limit: float, family_limit: float, *, observable: Mapping[str, Mechanism]
) -> list[str]:
    """The candidates to refit: the best significant one, those with a similar gain, and those at its site with p up to
    ``family_limit``. A large effect is far from linear and may show little in a test at 0.
    """
    standing = [cause for cause, e in evidence.items() if is_significant(e, limit)]
    if not standing:
        return []
    best = max(standing, key=lambda cause: evidence[cause].gain)
    near = [cause for cause in standing if evidence[cause].gain > _SHORTLIST * evidence[best].gain]
    near = sorted(near, key=lambda cause: -evidence[cause].gain)[:_MAX_REFITS]
    relative = [
        cause
        for cause, e in evidence.items()
        if observable[cause].site == observable[best].site and e.p_adjusted <= family_limit and cause not in near
    ]
    return near + sorted(relative, key=lambda cause: -evidence[cause].gain)[:_MAX_FAMILY]


def refits_with(
    model: Model,
    causes: Sequence[str],
    observable: Mapping[str, Mechanism],
    *,
    measured: Measured,
    at_start: Mapping[str, Statistics] | None = None,
) -> dict[str, Model]:
    """The model with each cause added, where the fit is physically possible.

    Args:
        model: fitted to ``measured``.
        causes: to add, one at a time.
        observable: mechanisms by cause.
        measured: strokes.
        at_start: statistics of the model with each cause, if known.
    """
    known = at_start or {}
    refits = {cause: refit_with(model, observable[cause], measured, known.get(cause)) for cause in causes}
    return {cause: refit for cause, refit in refits.items() if is_physical(refit.mechanisms[-1])}


def refit_with(model: Model, mechanism: Mechanism, measured: Measured, at_start: Statistics | None = None) -> Model:
    """The model with one more mechanism.

    Fitted uneven ends hide a cause that moves the path from small steps. Such a cause is also tried without them.
    """
    refits = [fit(model.plus(mechanism), measured, at_start)]
    if mechanism.site == "trajectory" and any(isinstance(m, UnevenEnds) for m in model.mechanisms):
        refits.append(fit(model.without(UnevenEnds.cause).plus(mechanism), measured))
    return min(refits, key=lambda refit: float(action_losses(refit, measured).mean()))


def held_out_losses(model: Model, measured: Measured, seed: int) -> Array:
    """Error of each action, sRGB [n], had the last mechanism been fitted to the other folds only."""
    columns = model.columns_of(model.mechanisms[-1].cause)
    nuisances = np.setdiff1d(np.arange(len(model.vector)), columns)
    _, first = np.unique(measured.action, return_index=True)
    gains = held_out_gains(
        with_prior(linearise(model, measured), model), nuisances, columns, block=measured.block[first], seed=seed
    )
    return action_losses(model, measured) - gains


def with_refit_evidence(
    evidence: Mapping[str, Evidence],
    refits: Mapping[str, Model],
    limit: float,
    *,
    model: Model,
    measured: Measured,
    seed: int,
) -> dict[str, Evidence]:
    """The evidence, replaced by that of the refit where the score test is not significant, with Bonferroni's
    correction.

    The refit's evidence is the error that it removes from held-out actions.
    """
    unsaid = [cause for cause in refits if not is_significant(evidence[cause], limit)]
    # Refit the base too: the gain of a longer fit is not the cause's.
    before = action_losses(fit(model, measured) if unsaid else model, measured)
    weighed = dict(evidence)
    for cause in unsaid:
        gains = before - held_out_losses(refits[cause], measured, seed)
        p = paired_p(gains, seed)
        gain = mean_over_actions(gains / before.mean(), RESAMPLES, seed)
        weighed[cause] = Evidence(p, min(len(unsaid) * p, 1.0), *gain)
    return weighed


def is_physical(mechanism: Mechanism) -> bool:
    """Whether a mechanism's quantities have possible signs; for a lens, whether they can belong to one picture."""
    if isinstance(mechanism, LensDistortion):
        cubic, absorbed = map(float, mechanism.values)
        return _MIN_ABSORBED * cubic**2 <= absorbed * cubic <= _MAX_ABSORBED * cubic**2
    return signs_are_valid(mechanism)


def signs_are_valid(mechanism: Mechanism) -> bool:
    """Whether all quantities have possible signs."""
    return all(q.signed or float(v) >= 0 for q, v in zip(mechanism.quantities, mechanism.values, strict=True))


def is_large(mechanism: Mechanism) -> bool:
    """Whether a quantity is at least ``_LARGE`` times its typical size."""
    return any(abs(float(v)) >= _LARGE * q.typical for q, v in zip(mechanism.quantities, mechanism.values, strict=True))


def is_far(model: Model, measured: Measured) -> bool:
    """Whether the last mechanism moves marks by more than their half-width (root mean square), which is far from
    linear.
    """
    moved, unmoved = mark_px(model, measured), mark_px(model.without(model.mechanisms[-1].cause), measured)
    return bool(np.square(moved[..., :2] - unmoved[..., :2]).sum(-1).mean() > np.square(unmoved[..., 2]).mean())


def displaces(mechanism: Mechanism) -> bool:
    """Whether it moves the mark; other mechanisms change the mark in place."""
    return mechanism.site == "trajectory" or isinstance(mechanism, LensDistortion)


def can_mimic(other: Mechanism, mechanism: Mechanism) -> bool:
    """Whether the error of one cause's form may look like another cause: both displace the mark, or neither does.

    A displacement error has two signs across a mark, which no width explains. A cause without covariates has no form
    that could be wrong.
    """
    return displaces(other) == displaces(mechanism) and bool(other.informative_covariates)


def form_error_share(other: Mechanism, mechanism: Mechanism) -> float:
    """The share of one cause's effect that its form's error may leave for another cause."""
    if not can_mimic(other, mechanism):
        return 0.0
    if other.driving_covariate == mechanism.driving_covariate:
        return _LEFT_TO_SAME_FAMILY
    unrelated = mechanism.informative_covariates and not set(other.informative_covariates) & set(
        mechanism.informative_covariates
    )
    return _LEFT_TO_UNRELATED if unrelated else _LEFT


def backward_elimination(
    model: Model, kept: frozenset[str], measured: Measured, *, seed: int, log: Callable[[str], None]
) -> Model:
    """Drop mechanisms that the model no longer needs beside its last one, or whose sign became impossible.

    Args:
        kept: causes that are only dropped for an impossible sign.
    """
    for mechanism in model.mechanisms[:-1]:
        ends = isinstance(mechanism, UnevenEnds)
        if ends and model.mechanisms[-1].site != "trajectory":
            continue
        possible = signs_are_valid(mechanism)
        if possible and mechanism.cause in kept:
            continue
        refit = fit(model.without(mechanism.cause), measured)
        limit = LATER_P if ends else _KEEP_P
        worse_p = paired_p(action_losses(refit, measured) - action_losses(model, measured), seed)
        if not possible or worse_p > limit:
            log(f"{mechanism.cause} is no longer needed")
            return backward_elimination(refit, kept, measured, seed=seed, log=log)
    return model
