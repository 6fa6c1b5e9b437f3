"""Forward selection of causes: test all, refit the few that stand out, take the best, relinearise, look back."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.gap.ends import UnevenEnds
from pentimento.gap.fit import fit
from pentimento.gap.foretell import Model, identity, linearise, residual, weighted_error
from pentimento.gap.measured import Measured
from pentimento.gap.score import Evidence, held_out_gains, interval_of_mean, score_tests
from pentimento.stroke_dynamics.simulation import Mechanism, NotObservable

Array = NDArray[Any]

_DRAWS = 4999
_FIRST_P, _LATER_P = 0.02, 0.01
_WORSE_P = 0.05
_SHORTLIST = 0.4  # of the best gain
_MOST_REFITS, _MOST_KIN = 4, 2
_KIN_P = 0.05
_LEAST_OF_FLOOR, _LEAST_OF_MISFIT = 0.006, 0.004
"""Of the noise floor, and of the error above it: in a base that is wrong in many ways, something always looks a little
like a cause."""
_MOST_CAUSES, _MOST_STEPS = 6, 9
_BESIDE, _BESIDE_SAME_DRIVER = 0.03, 0.35
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
    not_observable: dict[str, str]
    """Causes that these strokes cannot show, and why."""


def search(
    start: Model,
    measured: Measured,
    noise_share: float,
    vocabulary: Sequence[type[Mechanism]],
    seed: int,
    log: Callable[[str], None],
) -> Search:
    """Extend the base, fitted from ``start``, by what the strokes speak for.

    ``noise_share`` of the base's error is the noise floor; 0 if that is unknown.
    """
    base = model = fit(start.plus(identity(UnevenEnds, measured.context)), measured)
    plain = measured.whole()
    floor = noise_share * float(action_losses(base, plain).mean())
    observable: dict[str, Mechanism] = {}
    unseen: dict[str, str] = {}
    for kind in vocabulary:
        try:
            observable[kind.cause] = identity(kind, measured.context)
        except NotObservable as reason:
            unseen[kind.cause] = str(reason)
    steps: list[Step] = []
    gained: dict[Mechanism, float] = {}
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
        error = float(action_losses(model, plain).mean())
        least = max(_LEAST_OF_FLOOR * (floor or error), _LEAST_OF_MISFIT * (error - floor))
        standing = {cause: e for cause, e in fresh.items() if e.p_adjusted < limit and e.gain_interval[0] > 0}
        if not standing or number == _MOST_CAUSES or len(steps) == _MOST_STEPS:
            steps.append(Step(evidence, None, ()))
            break
        short = _shortlist(fresh, standing, observable)
        refits = {cause: _refit(model, observable[cause], measured) for cause in short}
        refits = {cause: refit for cause, refit in refits.items() if is_physical(refit.mechanisms[-1])}
        dismissed |= set(short) - set(refits)
        sizes = weigh(model, [observable[cause] for cause in refits], plain, seed)
        size = {cause: sizes[cause].gain * error for cause in refits}
        small = {cause for cause in refits if size[cause] < max(least, _enough(observable[cause], gained))}
        dismissed |= small
        refits = {cause: refit for cause, refit in refits.items() if cause not in small}
        if not refits:
            continue
        losses = {cause: action_losses(refit, measured) for cause, refit in refits.items()}
        chosen = min(losses, key=lambda cause: float(losses[cause].mean()))
        rivals = tuple(
            cause for cause in refits if cause != chosen and not _is_worse(losses[cause] - losses[chosen], seed)
        )
        log(f"{chosen}: error {losses[chosen].mean():.3g}" + (f", rivals {', '.join(rivals)}" if rivals else ""))
        steps.append(Step(evidence, chosen, rivals))
        gained[observable[chosen]] = max(size[chosen], error - float(action_losses(refits[chosen], plain).mean()))
        model = _without_idle(refits[chosen], measured, seed, log)
    return Search(base, model, tuple(steps), unseen)


def _enough(mechanism: Mechanism, gained: Mapping[Mechanism, float]) -> float:
    """How much error a further cause must remove, sRGB."""
    return max(
        (gain * (_BESIDE_SAME_DRIVER if m.driver == mechanism.driver else _BESIDE) for m, gain in gained.items()),
        default=0.0,
    )


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
        evidence[cause] = Evidence(*tests[cause], float(gains.mean()), interval_of_mean(gains, 999, seed))
    return evidence


def _shortlist(
    evidence: Mapping[str, Evidence], standing: Mapping[str, Evidence], observable: Mapping[str, Mechanism]
) -> list[str]:
    """Who is worth a refit: the best, those near to it, and those suspected that share its driver.

    The last because a large effect is far from linear: a lag of centimetres looks like little from no lag at all.
    """
    by_gain = sorted(standing, key=lambda cause: -standing[cause].gain)
    best = by_gain[0]
    near = [cause for cause in by_gain if standing[cause].gain > _SHORTLIST * standing[best].gain][:_MOST_REFITS]
    kin = [
        cause
        for cause, e in evidence.items()
        if observable[cause].site == observable[best].site and e.p_adjusted < _KIN_P and cause not in near
    ]
    return near + sorted(kin, key=lambda cause: -evidence[cause].gain)[:_MOST_KIN]


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


def action_losses(model: Model, measured: Measured) -> Array:
    """Weighted mean squared error of each action over its rows, sRGB, in the order of the actions' numbers."""
    rows = weighted_error(residual(model, measured), measured)
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


def _is_worse(differences: Array, seed: int) -> bool:
    return paired_p(differences, seed) < _WORSE_P


def _without_idle(model: Model, measured: Measured, seed: int, log: Callable[[str], None]) -> Model:
    """The model less the mechanisms that it no longer needs, now that it has a new one."""
    for mechanism in model.mechanisms[:-1]:
        if isinstance(mechanism, UnevenEnds) and model.mechanisms[-1].site != "trajectory":
            continue
        refit = fit(model.without(mechanism.cause), measured)
        if paired_p(action_losses(refit, measured) - action_losses(model, measured), seed) > _LATER_P:
            log(f"{mechanism.cause} is no longer needed")
            return _without_idle(refit, measured, seed, log)
    return model
