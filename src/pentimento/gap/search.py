"""Forward selection of causes: test all, refit the few that stand out, take the best, relinearise, look back.

It is done twice. Large causes are looked for first: in a residual that holds them, what a tool does alike in every
stroke (``habits``) cannot be learnt. The others are looked for with that in what is foretold.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.gap.choice import Step, paired_p, simplest_of_the_best, without_echoes, without_unlikely
from pentimento.gap.ends import UnevenEnds
from pentimento.gap.fit import fit
from pentimento.gap.foretell import Model, identity, mark_px, mean_squared_error, residual
from pentimento.gap.jacobian import linearise
from pentimento.gap.measured import Measured
from pentimento.gap.score import Evidence, held_out_gains, mean_and_bounds, score_tests
from pentimento.stroke_dynamics.mechanisms.lens_distortion import LensDistortion
from pentimento.stroke_dynamics.simulation import Mechanism, NotObservable, StrokeContext

Array = NDArray[Any]

_DRAWS = 4999
_FIRST_P, _LATER_P = 0.02, 0.01
_SHORTLIST = 0.4  # of the best gain
_MOST_REFITS, _MOST_KIN = 4, 2
_KIN_P = 0.05
_LEAST_OF_FLOOR, _LEAST_OF_MISFIT = 0.01, 0.008
"""Of the noise floor, and of the error above it: in a base that is wrong in many ways, something always looks a little
like a cause."""
_LARGE, _LARGE_OF_MISFIT = 2.0, 0.04
"""Typical sizes, and the share that it removes of the error above the noise floor: a large cause has both."""
_LEAST_TAKEN_UP, _MOST_TAKEN_UP = -0.5, 3.0
"""Of a lens's displacement at the strokes' edge: nothing where a picture is not rectified; where it is, what brings
markers a little beyond the strokes back to their places. What is linear alone is a wrong scale, and no lens."""
_MOST_CAUSES, _MOST_STEPS = 6, 9
_BESIDE, _BESIDE_SAME_DRIVER = 0.05, 0.7
"""Of the largest gain so far: what a further cause must add. A little is always left where the effect's true form is
not the mechanism's; it is taken up by causes of the same driver first."""
_ALL_BUT = 0.95
"""Of the error that uneven ends remove, and of what they do beside a cause: where it removes as much without them, it
needs none."""


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


def find_large(
    start: Model,
    measured: Measured,
    all_strokes: StrokeContext,
    noise_share: float,
    vocabulary: Sequence[type[Mechanism]],
    seed: int,
    log: Callable[[str], None],
) -> Search:
    """Extend the base, fitted from ``start``, by causes that explain a good part of what it leaves.

    Args:
        all_strokes: with those that causes will be confirmed and valued on: a cause must be observable there, too.
        noise_share: what of the base's error is the noise floor; 0 if that is unknown.
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
    quantities = _quantities(observable)
    steps: list[Step] = []
    gained: dict[str, float] = {}
    instead = _instead_of_ends(plain, base, floor, observable, measured)
    evidence = weigh(plain, list(observable.values()), measured, seed) if instead else {}
    instead = {cause: refit for cause, refit in instead.items() if _stands(evidence[cause], _FIRST_P)}
    if instead:
        losses = {cause: action_losses(refit, measured) for cause, refit in instead.items()}
        before = float(action_losses(plain, measured).mean())
        step = without_echoes(simplest_of_the_best(evidence, losses, before, quantities, seed, log), instead, measured)
        assert step.chosen is not None
        steps.append(step)
        base, model = plain, instead[step.chosen]
        error = float(losses[step.chosen].mean())
        gained[step.chosen] = before - error
    while len(steps) < _MOST_CAUSES:
        taken = {m.cause for m in model.mechanisms}
        candidates = [m for cause, m in observable.items() if cause not in taken]
        evidence = weigh(model, candidates, measured, seed + len(steps))
        limit = _LATER_P if steps else _FIRST_P
        short = _shortlist(evidence, limit, 1.0, observable)
        found = _large_step(
            model, _refits(model, short, observable, measured), evidence, limit, floor, measured, seed, log
        ) or _large_step(model, _far(model, candidates, measured), evidence, limit, floor, measured, seed, log)
        if found is None:
            break
        step, refit = found
        assert step.chosen is not None
        steps.append(step)
        gained[step.chosen] = error - float(action_losses(refit, measured).mean())
        model = _without_idle(refit, frozenset(), measured, seed, log)
        error = float(action_losses(model, measured).mean())
    large = frozenset(m.cause for m in model.mechanisms if m.cause in observable and is_large(m))
    return Search(base, model, tuple(steps), observable, unseen, floor, gained, large)


def search(begun: Search, measured: Measured, seed: int, log: Callable[[str], None]) -> Search:
    """Go on with what was begun, by ``find_large`` or by this, with the tool's habits in what is foretold."""
    model = fit(begun.model, measured)
    observable, quantities = begun.observable, _quantities(begun.observable)
    steps = [step for step in begun.steps if step.chosen]
    gained = dict(begun.gained)
    evidence: dict[str, Evidence] = {}
    dismissed: set[str] = set()
    """Causes that would have to act with the wrong sign, or do too little."""
    while True:
        number = sum(m.cause in observable for m in model.mechanisms)
        taken = {m.cause for m in model.mechanisms}
        candidates = [m for cause, m in observable.items() if cause not in taken | dismissed]
        fresh = weigh(model, candidates, measured, seed + len(steps))
        evidence = {cause: e for cause, e in evidence.items() if cause in dismissed - taken} | fresh
        limit = _LATER_P if number else _FIRST_P
        short = _shortlist(fresh, limit, _KIN_P, observable)
        if not short or number == _MOST_CAUSES or len(steps) == _MOST_STEPS:
            steps.append(Step(evidence, None, ()))
            break
        refits = _refits(model, short, observable, measured)
        dismissed |= set(short) - set(refits)
        before = action_losses(model, measured)
        error = float(before.mean())
        least = max(_LEAST_OF_FLOOR * (begun.floor or error), _LEAST_OF_MISFIT * (error - begun.floor))
        losses = {cause: _held_out_losses(refit, measured, seed) for cause, refit in refits.items()}
        size = {cause: float((before - each).mean()) for cause, each in losses.items()}
        small = {c for c in losses if size[c] < max(least, _enough(observable[c], observable, gained))}
        dismissed |= small
        losses = {cause: after for cause, after in losses.items() if cause not in small}
        # From no effect a large one may look like little; what its refit removes is then the witness.
        removes_p = {cause: paired_p(before - after, seed) for cause, after in losses.items()}
        sure = {
            cause
            for cause in losses
            if _stands(fresh[cause], limit) and (fresh[cause].least_gain > 0 or removes_p[cause] < _LATER_P)
        }
        if not sure:  # what was tried for the sake of a cause that is dismissed is not enough by itself
            dismissed |= {cause for cause in losses if _stands(fresh[cause], limit)}
            continue
        losses = without_unlikely(losses, refits, measured)
        step = without_echoes(simplest_of_the_best(evidence, losses, error, quantities, seed, log), refits, measured)
        steps.append(step)
        assert step.chosen is not None
        gained[step.chosen] = size[step.chosen]
        model = _without_idle(refits[step.chosen], begun.large, measured, seed, log)
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
        if chosen is None or chosen not in names or not rivals:
            steps.append(replace(step, rivals=tuple(rivals)))
            continue
        without = fit(model.without(chosen), measured)
        now = next(m for m in model.mechanisms if m.cause == chosen)
        refits = {chosen: fit(model.without(chosen).plus(now), measured)}
        refits |= _refits(without, rivals, found.observable, measured)
        losses = {cause: action_losses(refit, measured) for cause, refit in refits.items()}
        error = float(action_losses(without, measured).mean())
        settled = simplest_of_the_best(
            step.evidence, losses, error, _quantities({cause: found.observable[cause] for cause in losses}), seed, log
        )
        settled = without_echoes(settled, refits, measured)
        assert settled.chosen is not None
        steps.append(settled)
        if settled.chosen != chosen:
            model = refits[settled.chosen]
            gained[settled.chosen] = gained.pop(chosen)
    return replace(found, model=model, steps=tuple(steps), gained=gained)


def _quantities(observable: Mapping[str, Mechanism]) -> dict[str, int]:
    return {cause: len(mechanism.quantities) for cause, mechanism in observable.items()}


def _held_out_losses(model: Model, measured: Measured, seed: int) -> Array:
    """Mean squared error of each action, sRGB, [n], had its last mechanism been fitted to the other blocks alone."""
    columns = model.columns_of(model.mechanisms[-1].cause)
    held = np.setdiff1d(np.arange(len(model.vector)), columns)
    _, first = np.unique(measured.action, return_index=True)
    gains = held_out_gains(linearise(model, measured), held, columns, measured.block[first], seed)
    return action_losses(model, measured) - gains


def _instead_of_ends(
    plain: Model, uneven: Model, floor: float, observable: Mapping[str, Mechanism], measured: Measured
) -> dict[str, Model]:
    """The plain base with each cause that does what its ``uneven`` ends do, in their place, where one of these leaves
    them nothing to do: a lag is one number, and explains why a mark is short where it ends; uneven ends are four, and
    hide it.
    """

    def left(model: Model) -> float:
        return float(action_losses(model, measured).mean())

    missed, at_best = left(plain), left(uneven)
    if missed - at_best < _LARGE_OF_MISFIT * (missed - floor):
        return {}
    alike = [cause for cause, mechanism in observable.items() if mechanism.driver == UnevenEnds.driver]
    instead = _refits(plain, alike, observable, measured)
    removed = {cause: missed - left(refit) for cause, refit in instead.items()}
    instead = {c: refit for c, refit in instead.items() if removed[c] >= _ALL_BUT * (missed - at_best)}
    ends = identity(UnevenEnds, measured.context)
    if any(removed[c] >= _ALL_BUT * (missed - left(fit(r.plus(ends), measured))) for c, r in instead.items()):
        return instead
    return {}


def _enough(mechanism: Mechanism, observable: Mapping[str, Mechanism], gained: Mapping[str, float]) -> float:
    """How much error a further cause must remove, sRGB, to be more than what those of its kind have left: among what
    displaces the mark, or among the others. What a displacement leaves has two signs across a mark: no width takes it
    up.
    """
    alike = {cause: gain for cause, gain in gained.items() if displaces(observable[cause]) == displaces(mechanism)}
    same = {cause: observable[cause].driver == mechanism.driver for cause in alike}
    return max((gain * (_BESIDE_SAME_DRIVER if same[c] else _BESIDE) for c, gain in alike.items()), default=0.0)


def displaces(mechanism: Mechanism) -> bool:
    """Whether it moves the mark; the others change it where it lies."""
    return mechanism.site == "trajectory" or isinstance(mechanism, LensDistortion)


def weigh(model: Model, candidates: Sequence[Mechanism], measured: Measured, seed: int) -> dict[str, Evidence]:
    """Evidence for each candidate at a fitted model."""
    if not candidates:
        return {}
    statistics = linearise(model.plus(*candidates), measured)
    held = np.arange(len(model.vector))
    index, at = {}, len(held)
    for mechanism in candidates:
        index[mechanism.cause] = np.arange(at, at + len(mechanism.quantities))
        at += len(mechanism.quantities)
    tests = score_tests(statistics, held, index, _DRAWS, seed)
    error = float(statistics.energy.mean())
    _, first = np.unique(measured.action, return_index=True)
    blocks = measured.block[first]
    evidence = {}
    for cause, columns in index.items():
        gains = held_out_gains(statistics, held, columns, blocks, seed) / error
        gain, interval, least = mean_and_bounds(gains, 999, seed)
        evidence[cause] = Evidence(*tests[cause], gain, interval, least)
    return evidence


def _stands(evidence: Evidence, limit: float) -> bool:
    return evidence.p_adjusted < limit and evidence.gain > 0


def _shortlist(
    evidence: Mapping[str, Evidence], limit: float, kin_limit: float, observable: Mapping[str, Mechanism]
) -> list[str]:
    """Who is worth a refit: the best of those whose p is below ``limit``, those near to it, and those at its site whose
    p is at most ``kin_limit``: a large effect is far from linear, and a lag of centimetres looks like little from none.
    """
    standing = [cause for cause, e in evidence.items() if _stands(e, limit)]
    if not standing:
        return []
    best = max(standing, key=lambda cause: evidence[cause].gain)
    near = [cause for cause in standing if evidence[cause].gain > _SHORTLIST * evidence[best].gain]
    near = sorted(near, key=lambda cause: -evidence[cause].gain)[:_MOST_REFITS]
    kin = [
        cause
        for cause, e in evidence.items()
        if observable[cause].site == observable[best].site and e.p_adjusted <= kin_limit and cause not in near
    ]
    return near + sorted(kin, key=lambda cause: -evidence[cause].gain)[:_MOST_KIN]


def _far(model: Model, candidates: Sequence[Mechanism], measured: Measured) -> dict[str, Model]:
    """The model with each cause by which a tip trails, where that is by more than the mark's half-width.

    The tests are about no effect. There, and in every small step from there, such a cause may show nothing of what it
    does: it is fitted from its typical size.
    """
    refits = {}
    for mechanism in candidates:
        if mechanism.site == "trajectory" and not any(quantity.signed for quantity in mechanism.quantities):
            typical = torch.tensor([quantity.typical for quantity in mechanism.quantities], dtype=torch.float64)
            refit = _refit(model, type(mechanism)(typical, mechanism.reference), measured)
            if is_physical(refit.mechanisms[-1]) and is_far(refit, measured):
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
    """The step to the best of the refits of causes, where it removes a good part of the error and is large or far; and
    that refit.
    """
    evidence = _with_that_of_refits(evidence, refits, limit, model, measured, seed)
    error = float(action_losses(model, measured).mean())
    losses = {c: action_losses(refit, measured) for c, refit in refits.items() if _stands(evidence[c], limit)}
    losses = {c: each for c, each in losses.items() if error - each.mean() >= _LARGE_OF_MISFIT * (error - floor)}
    if not losses:
        return None
    losses = without_unlikely(losses, refits, measured)
    quantities = _quantities({cause: refits[cause].mechanisms[-1] for cause in losses})
    step = without_echoes(simplest_of_the_best(evidence, losses, error, quantities, seed, log), refits, measured)
    assert step.chosen is not None
    best = refits[step.chosen]
    return (step, best) if is_large(best.mechanisms[-1]) or is_far(best, measured) else None


def _with_that_of_refits(
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
    unsaid = [cause for cause in refits if not _stands(evidence[cause], limit)]
    # What the base alone gains by being fitted longer is no cause's.
    before = action_losses(fit(model, measured) if unsaid else model, measured)
    weighed = dict(evidence)
    for cause in unsaid:
        gains = before - _held_out_losses(refits[cause], measured, seed)
        p = paired_p(gains, seed)
        weighed[cause] = Evidence(p, min(len(unsaid) * p, 1.0), *mean_and_bounds(gains / before.mean(), 999, seed))
    return weighed


def _refits(
    model: Model, causes: Sequence[str], observable: Mapping[str, Mechanism], measured: Measured
) -> dict[str, Model]:
    """The model with each cause added, where its fit makes physical sense."""
    refits = {cause: _refit(model, observable[cause], measured) for cause in causes}
    return {cause: refit for cause, refit in refits.items() if is_physical(refit.mechanisms[-1])}


def _refit(model: Model, mechanism: Mechanism, measured: Measured) -> Model:
    """The model with one more mechanism.

    Ends that have been fitted in the place of a cause that moves the path hide it from small steps: such a cause is
    tried without them, too.
    """
    refits = [fit(model.plus(mechanism), measured)]
    if mechanism.site == "trajectory" and any(isinstance(m, UnevenEnds) for m in model.mechanisms):
        refits.append(fit(model.without(UnevenEnds.cause).plus(mechanism), measured))
    return min(refits, key=lambda refit: float(action_losses(refit, measured).mean()))


def is_physical(mechanism: Mechanism) -> bool:
    """Whether all of its quantities have signs that they can have; of a lens, whether they can be of one picture."""
    if isinstance(mechanism, LensDistortion):
        at_edge, taken_up = map(float, mechanism.values)
        return _LEAST_TAKEN_UP * at_edge**2 <= taken_up * at_edge <= _MOST_TAKEN_UP * at_edge**2
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


def action_losses(model: Model, measured: Measured) -> Array:
    """Mean squared error of each action over its rows, sRGB, in the order of the actions' numbers."""
    rows = mean_squared_error(residual(model, measured), measured)
    _, group = np.unique(measured.action, return_inverse=True)
    return np.bincount(group, rows) / np.bincount(group)


def _without_idle(
    model: Model, kept: frozenset[str], measured: Measured, seed: int, log: Callable[[str], None]
) -> Model:
    """The model less the mechanisms that it no longer needs, now that it has a new one; the causes ``kept`` stay."""
    for mechanism in model.mechanisms[:-1]:
        if mechanism.cause in kept or (isinstance(mechanism, UnevenEnds) and model.mechanisms[-1].site != "trajectory"):
            continue
        refit = fit(model.without(mechanism.cause), measured)
        if paired_p(action_losses(refit, measured) - action_losses(model, measured), seed) > _LATER_P:
            log(f"{mechanism.cause} is no longer needed")
            return _without_idle(refit, kept, measured, seed, log)
    return model
