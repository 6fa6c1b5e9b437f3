"""What speaks for a cause that a model does not have yet: tests at the model, and the model refitted with it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.gauss_newton import Statistics
from pentimento.diagnosis.score import Evidence, held_out_gains, mean_and_bounds, paired_p, weighed, with_each
from pentimento.diagnosis.strokes.fit import fit, held, steadied
from pentimento.diagnosis.strokes.jacobian import linearise
from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.model import Model, UnevenEnds
from pentimento.diagnosis.strokes.predict import action_losses, mark_px
from pentimento.dynamics.strokes.mechanisms.lens_distortion import LensDistortion
from pentimento.dynamics.strokes.simulation import Mechanism

Array = NDArray[Any]

FIRST_P, LATER_P = 0.02, 0.01
_IDLE_P = 0.05
"""Beyond it a cause of the model is idle beside a new one: to stay asks for less than to come. Uneven ends, which stand
in for a cause that moves the path, stay only as surely as one comes."""
_SHORTLIST = 0.4  # of the best gain
_MAX_REFITS, _MAX_KIN = 4, 2
_LARGE = 2.0  # times what is typical
_LEFT, _LEFT_TO_ITS_DRIVER, _LEFT_TO_THE_UNRELATED = 0.05, 0.1, 0.01
"""Of what a cause removes. A little is always left where an effect's true form is not the mechanism's; it is taken up
by causes of the same driver first."""
_MIN_PICKUP, _MAX_TAKEN_UP = -0.5, 3.0
"""Of a lens's displacement at the strokes' edge: nothing where a picture is not rectified; where it is, what brings
markers a little beyond the strokes back to their places. What is linear alone is a wrong scale, and no lens."""


def weigh(
    model: Model, candidates: Sequence[Mechanism], measured: Measured, seed: int
) -> tuple[dict[str, Evidence], dict[str, Statistics]]:
    """Evidence for each candidate at a fitted model, and the statistics of the model with it."""
    if not candidates:
        return {}, {}
    full = model.plus(*candidates)
    statistics = linearise(full, measured)
    # As stiff as a fit holds the base, or a step that none would take (paint far from what was told) would do a cause's
    # work. Without its pull, which would be charged to whatever a cause shares with the base.
    stiff = steadied(statistics, full, 1.0)
    _, first = np.unique(measured.action, return_index=True)
    quantities = {mechanism.cause: len(mechanism.quantities) for mechanism in candidates}
    size = len(model.vector)
    return weighed(stiff, size, quantities, measured.block[first], seed), with_each(statistics, size, quantities)


def stands(evidence: Evidence, limit: float) -> bool:
    """Whether a test at a model without the cause speaks for it, and it is of use on strokes it is not fitted to."""
    return evidence.p_adjusted < limit and evidence.gain > 0


def shortlist(
    evidence: Mapping[str, Evidence], limit: float, kin_limit: float, observable: Mapping[str, Mechanism]
) -> list[str]:
    """Who is worth a refit: the best of those whose p is below ``limit``, those near to it, and those at its site whose
    p is at most ``kin_limit``: a large effect is far from linear, and a lag of centimetres looks like little from none.
    """
    standing = [cause for cause, e in evidence.items() if stands(e, limit)]
    if not standing:
        return []
    best = max(standing, key=lambda cause: evidence[cause].gain)
    near = [cause for cause in standing if evidence[cause].gain > _SHORTLIST * evidence[best].gain]
    near = sorted(near, key=lambda cause: -evidence[cause].gain)[:_MAX_REFITS]
    kin = [
        cause
        for cause, e in evidence.items()
        if observable[cause].site == observable[best].site and e.p_adjusted <= kin_limit and cause not in near
    ]
    return near + sorted(kin, key=lambda cause: -evidence[cause].gain)[:_MAX_KIN]


def refits_with(
    model: Model,
    causes: Sequence[str],
    observable: Mapping[str, Mechanism],
    measured: Measured,
    at_start: Mapping[str, Statistics] | None = None,
) -> dict[str, Model]:
    """The model with each cause added, where its fit makes physical sense.

    Args:
        at_start: statistics of the model with each, where they are known.
    """
    known = at_start or {}
    refits = {cause: refit_with(model, observable[cause], measured, known.get(cause)) for cause in causes}
    return {cause: refit for cause, refit in refits.items() if is_physical(refit.mechanisms[-1])}


def refit_with(model: Model, mechanism: Mechanism, measured: Measured, at_start: Statistics | None = None) -> Model:
    """The model with one more mechanism.

    Ends that have been fitted in the place of a cause that moves the path hide it from small steps: such a cause is
    tried without them, too.
    """
    refits = [fit(model.plus(mechanism), measured, at_start)]
    if mechanism.site == "trajectory" and any(isinstance(m, UnevenEnds) for m in model.mechanisms):
        refits.append(fit(model.without(UnevenEnds.cause).plus(mechanism), measured))
    return min(refits, key=lambda refit: float(action_losses(refit, measured).mean()))


def held_out_losses(model: Model, measured: Measured, seed: int) -> Array:
    """Mean squared error of each action, sRGB, [n], had its last mechanism been fitted to the other blocks alone."""
    columns = model.columns_of(model.mechanisms[-1].cause)
    nuisances = np.setdiff1d(np.arange(len(model.vector)), columns)
    _, first = np.unique(measured.action, return_index=True)
    gains = held_out_gains(held(linearise(model, measured), model), nuisances, columns, measured.block[first], seed)
    return action_losses(model, measured) - gains


def with_that_of_refits(
    evidence: Mapping[str, Evidence],
    refits: Mapping[str, Model],
    limit: float,
    model: Model,
    measured: Measured,
    seed: int,
) -> dict[str, Evidence]:
    """The evidence; where a cause's test does not speak for it, what its refit removes from actions that it was not
    fitted to, for as many as need that with Bonferroni's correction.
    """
    unsaid = [cause for cause in refits if not stands(evidence[cause], limit)]
    # What the base alone gains by being fitted longer is no cause's.
    before = action_losses(fit(model, measured) if unsaid else model, measured)
    weighed = dict(evidence)
    for cause in unsaid:
        gains = before - held_out_losses(refits[cause], measured, seed)
        p = paired_p(gains, seed)
        weighed[cause] = Evidence(p, min(len(unsaid) * p, 1.0), *mean_and_bounds(gains / before.mean(), 999, seed))
    return weighed


def is_physical(mechanism: Mechanism) -> bool:
    """Whether all of its quantities have signs that they can have; of a lens, whether they can be of one picture."""
    if isinstance(mechanism, LensDistortion):
        at_edge, picked_up = map(float, mechanism.values)
        return _MIN_PICKUP * at_edge**2 <= picked_up * at_edge <= _MAX_TAKEN_UP * at_edge**2
    return has_its_signs(mechanism)


def has_its_signs(mechanism: Mechanism) -> bool:
    """Whether all of its quantities have signs that they can have."""
    return all(q.signed or float(v) >= 0 for q, v in zip(mechanism.quantities, mechanism.values, strict=True))


def is_large(mechanism: Mechanism) -> bool:
    """Whether one of its quantities is many times what is typical."""
    return any(abs(float(v)) >= _LARGE * q.typical for q, v in zip(mechanism.quantities, mechanism.values, strict=True))


def is_far(model: Model, measured: Measured) -> bool:
    """Whether its last mechanism moves marks by more than their half-width, by the root mean square: so far that the
    surroundings of no effect say little of it.
    """
    moved, unmoved = mark_px(model, measured), mark_px(model.without(model.mechanisms[-1].cause), measured)
    return bool(np.square(moved[..., :2] - unmoved[..., :2]).sum(-1).mean() > np.square(unmoved[..., 2]).mean())


def displaces(mechanism: Mechanism) -> bool:
    """Whether it moves the mark; the others change it where it lies."""
    return mechanism.site == "trajectory" or isinstance(mechanism, LensDistortion)


def can_leave_what_looks_like(other: Mechanism, mechanism: Mechanism) -> bool:
    """Whether what the form of one cause lacks may look like another: where both displace the mark, or neither does.
    What a displacement leaves has two signs across a mark: no width takes it up.

    What is the same for all strokes has no form that could lack anything.
    """
    return displaces(other) == displaces(mechanism) and bool(other.informative_covariates)


def left_by_form(other: Mechanism, mechanism: Mechanism) -> float:
    """Of what one cause removes, how much its form may leave that looks like another: where this goes with something,
    and with nothing that it goes with, no more than chance, as strokes are drawn at random.
    """
    if not can_leave_what_looks_like(other, mechanism):
        return 0.0
    if other.driving_covariate == mechanism.driving_covariate:
        return _LEFT_TO_ITS_DRIVER
    unrelated = mechanism.informative_covariates and not set(other.informative_covariates) & set(
        mechanism.informative_covariates
    )
    return _LEFT_TO_THE_UNRELATED if unrelated else _LEFT


def without_idle(
    model: Model, kept: frozenset[str], measured: Measured, seed: int, log: Callable[[str], None]
) -> Model:
    """The model less the mechanisms that it no longer needs, now that it has a new one, or that would have to act with
    the wrong sign beside it; of the others the causes ``kept`` stay.
    """
    for mechanism in model.mechanisms[:-1]:
        ends = isinstance(mechanism, UnevenEnds)
        if ends and model.mechanisms[-1].site != "trajectory":
            continue
        possible = has_its_signs(mechanism)
        if possible and mechanism.cause in kept:
            continue
        refit = fit(model.without(mechanism.cause), measured)
        limit = LATER_P if ends else _IDLE_P
        worse_p = paired_p(action_losses(refit, measured) - action_losses(model, measured), seed)
        if not possible or worse_p > limit:
            log(f"{mechanism.cause} is no longer needed")
            return without_idle(refit, kept, measured, seed, log)
    return model
