"""Forward selection of causes: test all, refit the few that stand out, take the best, relinearise, look back.

It is done twice. Large causes are looked for first: in a residual that holds them, what a tool does alike in every
stroke (``habits``) cannot be learnt. The others are looked for with that in what is foretold.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.gap.ends import UnevenEnds
from pentimento.gap.fit import fit
from pentimento.gap.foretell import Model, identity, mean_squared_error, residual
from pentimento.gap.jacobian import linearise
from pentimento.gap.measured import Measured
from pentimento.gap.score import Evidence, held_out_gains, mean_and_bounds, score_tests
from pentimento.gap.standard_errors import values_with_errors
from pentimento.stroke_dynamics.simulation import Mechanism, NotObservable, StrokeContext

Array = NDArray[Any]

_DRAWS = 4999
_FIRST_P, _LATER_P = 0.02, 0.01
_WORSE_P = 0.05
_NEARLY = 0.95  # of what the best one removes
_SURE = 4.5  # standard errors of a quantity that one cause has beyond another
_SHORTLIST = 0.4  # of the best gain
_MOST_REFITS, _MOST_KIN = 4, 2
_KIN_P = 0.05
_LEAST_OF_FLOOR, _LEAST_OF_MISFIT = 0.01, 0.008
"""Of the noise floor, and of the error above it: in a base that is wrong in many ways, something always looks a little
like a cause."""
_LARGE, _LARGE_OF_MISFIT = 2.0, 0.04
"""Typical sizes, and the share that it removes of the error above the noise floor: a large cause has both."""
_MOST_CAUSES, _MOST_STEPS = 6, 9
_BESIDE, _BESIDE_SAME_DRIVER = 0.05, 0.7
"""Of the largest gain so far: what a further cause must add. A little is always left where the effect's true form is
not the mechanism's; it is taken up by causes of the same driver first."""


@dataclass(frozen=True)
class Step:
    """One round of the search."""

    evidence: dict[str, Evidence]
    """Of every candidate at the model so far; gains as shares of the error at that point."""
    chosen: str | None
    rivals: tuple[str, ...]
    """Causes whose refit in the chosen one's place is not worse at 5 %, paired by action."""


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
    base = model = fit(start.plus(identity(UnevenEnds, measured.context)), measured)
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
    while len(steps) < _MOST_CAUSES:
        taken = {m.cause for m in model.mechanisms}
        candidates = [m for cause, m in observable.items() if cause not in taken]
        evidence = weigh(model, candidates, measured, seed + len(steps))
        short = _shortlist(evidence, _LATER_P if steps else _FIRST_P, 1.0, observable)
        refits = _refits(model, short, observable, measured)
        losses = {cause: action_losses(refit, measured) for cause, refit in refits.items()}
        least = _LARGE_OF_MISFIT * (error - floor)
        losses = {cause: each for cause, each in losses.items() if error - each.mean() >= least}
        if not losses:
            break
        losses = _without_unlikely(losses, refits, measured)
        step = simplest_of_the_best(evidence, losses, error, quantities, seed, log)
        assert step.chosen is not None
        if not is_large(refits[step.chosen].mechanisms[-1]):
            break
        steps.append(step)
        gained[step.chosen] = error - float(losses[step.chosen].mean())
        model = _without_idle(refits[step.chosen], frozenset(), measured, seed, log)
        error = float(action_losses(model, measured).mean())
    large = frozenset(m.cause for m in model.mechanisms if m.cause in observable)
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
        sure = {
            cause
            for cause, after in losses.items()
            if _stands(fresh[cause], limit)
            and (fresh[cause].least_gain > 0 or paired_p(before - after, seed) < _LATER_P)
        }
        if not sure:  # what was tried for the sake of a cause that is dismissed is not enough by itself
            dismissed |= {cause for cause in losses if _stands(fresh[cause], limit)}
            continue
        losses = _without_unlikely(losses, refits, measured)
        step = simplest_of_the_best(evidence, losses, error, quantities, seed, log)
        steps.append(step)
        assert step.chosen is not None
        gained[step.chosen] = size[step.chosen]
        model = _without_idle(refits[step.chosen], begun.large, measured, seed, log)
    return replace(begun, model=model, steps=tuple(steps), gained=gained)


def simplest_of_the_best(
    evidence: dict[str, Evidence],
    losses: Mapping[str, Array],
    error: float,
    quantities: Mapping[str, int],
    seed: int,
    log: Callable[[str], None],
) -> Step:
    """The cause with the fewest quantities of those whose refit leaves no more error than the best one's, by losses [n]
    of each; the others are its rivals.

    What has a dozen quantities (each sheet of paper its own) can do what a tool's wear does, and a little more: of
    causes that cannot be told apart, the one with the fewest is taken. Nor can those be told apart of which one
    removes nearly as much of the ``error`` before them as the other, however surely less: no cause's form is quite
    right, and a spare quantity takes up what the form lacks.
    """
    least = min(losses, key=lambda cause: float(losses[cause].mean()))
    nearly = error - _NEARLY * (error - float(losses[least].mean()))
    tied = [c for c in losses if losses[c].mean() <= nearly or paired_p(losses[c] - losses[least], seed) >= _WORSE_P]
    chosen = min(tied, key=lambda c: (quantities[c], float(losses[c].mean())))
    rivals = tuple(cause for cause in tied if cause != chosen)
    log(f"{chosen}: error {losses[chosen].mean():.3g}" + (f", rivals {', '.join(rivals)}" if rivals else ""))
    return Step(evidence, chosen, rivals)


def _without_unlikely(losses: Mapping[str, Array], refits: Mapping[str, Model], measured: Measured) -> dict[str, Array]:
    """Of a cause and another that has all of its quantities and more, the right one, where what there is more is sure.

    Less paint at speed (``speed_density``) can do all that ``speed_bleed`` does, and is paler. If that is sure, it is
    named, but not where the rest contradicts it: then what is paler is a lack of the other's form.
    """
    last = {cause: refits[cause].mechanisms[-1] for cause in losses}
    names = {cause: {q.name for q in mechanism.quantities} for cause, mechanism in last.items()}
    out: set[str] = set()
    for cause in losses:
        within = {other for other in losses if names[other] < names[cause]}
        if not within:
            continue
        values = values_with_errors(refits[cause], last[cause], measured)
        sure = {name for name, (value, error) in values.items() if abs(value) > _SURE * error}
        told_apart = {other for other in within if sure - names[other]}
        if told_apart:
            out |= told_apart if last[cause].coherent else {cause}
    return {cause: each for cause, each in losses.items() if cause not in out}


def _quantities(observable: Mapping[str, Mechanism]) -> dict[str, int]:
    return {cause: len(mechanism.quantities) for cause, mechanism in observable.items()}


def _held_out_losses(model: Model, measured: Measured, seed: int) -> Array:
    """Mean squared error of each action, sRGB, [n], had its last mechanism been fitted to the other blocks alone."""
    columns = model.columns_of(model.mechanisms[-1].cause)
    held = np.setdiff1d(np.arange(len(model.vector)), columns)
    _, first = np.unique(measured.action, return_index=True)
    gains = held_out_gains(linearise(model, measured), held, columns, measured.block[first], seed)
    return action_losses(model, measured) - gains


def _enough(mechanism: Mechanism, observable: Mapping[str, Mechanism], gained: Mapping[str, float]) -> float:
    """How much error a further cause must remove, sRGB."""
    same = {cause: observable[cause].driver == mechanism.driver for cause in gained}
    return max((gain * (_BESIDE_SAME_DRIVER if same[c] else _BESIDE) for c, gain in gained.items()), default=0.0)


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
    """Whether all of its quantities have signs that they can have."""
    return all(q.signed or float(v) >= 0 for q, v in zip(mechanism.quantities, mechanism.values, strict=True))


def is_large(mechanism: Mechanism) -> bool:
    """Whether one of its quantities is many times what is typical."""
    return any(abs(float(v)) >= _LARGE * q.typical for q, v in zip(mechanism.quantities, mechanism.values, strict=True))


def action_losses(model: Model, measured: Measured) -> Array:
    """Mean squared error of each action over its rows, sRGB, in the order of the actions' numbers."""
    rows = mean_squared_error(residual(model, measured), measured)
    _, group = np.unique(measured.action, return_inverse=True)
    return np.bincount(group, rows) / np.bincount(group)


def paired_p(differences: Array, seed: int) -> float:
    """One-sided p that the mean of ``differences`` [n] is not above 0: sign flips of what is left after centring."""
    n = len(differences)
    signs = np.random.default_rng([seed, 5]).choice((-1.0, 1.0), (_DRAWS, n))
    observed = differences.mean() / max(differences.std(), 1e-300)
    flipped = signs * differences
    drawn = flipped.mean(1) / np.maximum(flipped.std(1), 1e-300)
    return float((1 + (drawn >= observed).sum()) / (_DRAWS + 1))


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
