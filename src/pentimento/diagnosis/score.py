"""Which causes the strokes speak for: cluster-robust score tests and held-out gains from statistics by action.

The action is the unit: pixels of one stroke share their errors. At the fitted model the projected score of a candidate
is, for each action,  s_i = g_ic - A_cb A_bb^-1 g_ib  with the nuisances b projected out, so that its signs can be
flipped at random without refitting anything (Rademacher wild bootstrap: Cameron, Gelbach and Miller 2008; Roodman et
al. 2019). The smallest p over all candidates gives the adjusted one (min-P: Westfall and Young 1993).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.statistics import interval, resamples
from pentimento.diagnosis.gauss_newton import Statistics

Array = NDArray[Any]

_RIDGE = 1e-6
_FOLDS = 6
_DRAWS, _RESAMPLED = 4999, 999
Scale = Callable[[Array, Array], Array]
"""From a candidate's projected slope [n, Q] and curvature [n, Q, Q] of each action to what its scores' sum is measured
by, [Q, Q]."""
_SIGN_FLIPS = 4999
_WORSE_P, _CONFIRMED_P = 0.05, 0.4
_NEARLY = 0.95  # of what the best one removes


class Evidence(NamedTuple):
    """For one candidate."""

    p: float
    """Of its own test."""
    p_adjusted: float
    """Over all candidates tested together."""
    gain: float
    """Mean squared error that it removes from held-out actions, per action, to second order."""
    gain_interval: tuple[float, float]
    """95 %."""
    min_gain: float
    """At 5 %, one-sided."""


def information(slope: Array, curvature: Array) -> Array:
    """How much error the candidate's numbers change: the statistic is the error that they would remove.

    It is not divided by what the scores' spread would make of it: signs say how far chance goes, and where few actions
    show a cause (paint is crossed in few strokes) that spread is the effect itself.
    """
    total: Array = curvature.sum(0)
    return total


def scatter(slope: Array, curvature: Array) -> Array:
    """How far the actions' scores spread: the statistic is a robust one (Wald's). Where every action has much chance of
    its own in some of a candidate's numbers and little in others, the error that the first seem to remove would drown
    the second: each push comes to lie half a millimetre too high or too low.
    """
    return slope.T @ slope


def weighed(
    statistics: Statistics,
    nuisances: int,
    quantities: Mapping[str, int],
    block: Array,
    seed: int,
    scales: Sequence[Scale] = (information,),
) -> dict[str, Evidence]:
    """Evidence for each candidate at a fitted model.

    Args:
        statistics: of the model's own numbers, the ``nuisances``, and after them those of all candidates.
        quantities: how many numbers each candidate has, in their order.
        block: of each action, [n]: what is left out together.
    """
    held = np.arange(nuisances)
    index = _columns(nuisances, quantities)
    tests = score_tests(statistics, held, index, _DRAWS, seed, scales)
    error = float(statistics.energy.mean())
    evidence = {}
    for cause, columns in index.items():
        gains = held_out_gains(statistics, held, columns, block, seed) / error
        p, adjusted = tests[cause]
        gain, interval, minimum = mean_and_bounds(gains, _RESAMPLED, seed)
        evidence[cause] = Evidence(p, adjusted, gain, interval, minimum)
    return evidence


def with_each(statistics: Statistics, nuisances: int, quantities: Mapping[str, int]) -> dict[str, Statistics]:
    """The statistics of the model with each candidate alone; arguments as of ``weighed``."""
    own = np.arange(nuisances)
    columns = _columns(nuisances, quantities)
    return {cause: statistics.of(np.concatenate([own, its])) for cause, its in columns.items()}


def _columns(nuisances: int, quantities: Mapping[str, int]) -> dict[str, Array]:
    """Where the numbers of each candidate stand."""
    ends = nuisances + np.cumsum(list(quantities.values()))
    return {cause: np.arange(end - quantities[cause], end) for cause, end in zip(quantities, ends, strict=True)}


def project(statistics: Statistics, nuisances: Array, candidate: Array) -> Array:
    """Scores of a candidate's numbers with the nuisances projected out, [n, Q]."""
    pull = _pull(statistics, nuisances, candidate)
    projected: Array = statistics.slope[:, candidate] - statistics.slope[:, nuisances] @ pull
    return projected


def projected(statistics: Statistics, nuisances: Array, candidate: Array) -> tuple[Array, Array]:
    """Slope [n, Q] and curvature [n, Q, Q] of each action in a candidate's numbers, with what the nuisances do to make
    up for them, over all actions, projected out.
    """
    pull = _pull(statistics, nuisances, candidate)
    slope = statistics.slope[:, candidate] - statistics.slope[:, nuisances] @ pull
    made_up = pull.T @ statistics.curvature[:, nuisances][:, :, candidate]
    curvature = statistics.curvature[:, candidate][:, :, candidate] - made_up - made_up.swapaxes(1, 2)
    curvature += pull.T @ statistics.curvature[:, nuisances][:, :, nuisances] @ pull
    return slope, curvature


def _pull(statistics: Statistics, nuisances: Array, candidate: Array) -> Array:
    """What the nuisances do to make up for the candidate's numbers, [nuisances, candidate]."""
    curvature = statistics.curvature.sum(0)
    held = curvature[np.ix_(nuisances, nuisances)]
    return np.asarray(np.linalg.lstsq(_ridged(held), curvature[np.ix_(nuisances, candidate)], rcond=None)[0])


def explained(pulls: Array, scale: Array) -> Array:
    """The statistic of a candidate, [R], were its actions' scores to sum up to pulls [R, Q]; ``scale`` [Q, Q]: by its
    information the error that it would remove.
    """
    each = np.sqrt(np.maximum(np.diag(scale), 1e-300))
    scaled = pulls / each
    removed: Array = np.einsum("rq,qr->r", scaled, np.linalg.solve(_ridged(scale / np.outer(each, each)), scaled.T))
    return removed


def score_tests(
    statistics: Statistics,
    nuisances: Array,
    candidates: Mapping[str, Array],
    draws: int,
    seed: int,
    scales: Sequence[Scale] = (information,),
) -> dict[str, tuple[float, float]]:
    """(p, adjusted p) of each candidate by the wild bootstrap over actions.

    What is compared over all candidates is their p: statistics of those that few actions show have longer tails, which
    would drown the others. Of several ``scales`` the one counts by which a candidate has the smaller p, in every draw.
    """
    n = len(statistics.energy)
    signs = np.concatenate([np.ones((1, n)), np.random.default_rng([seed, 1]).choice((-1.0, 1.0), (draws, n))])
    p = np.empty((len(candidates), draws + 1))  # in the first column as observed
    for c, index in enumerate(candidates.values()):
        slope, curvature = projected(statistics, nuisances, index)
        by_each = [_share_at_least(explained(signs @ slope, scale(slope, curvature))) for scale in scales]
        p[c] = _share_at_most(np.min(by_each, axis=0))
    smallest = p.min(0)
    return {name: (float(p[c, 0]), float((smallest <= p[c, 0]).mean())) for c, name in enumerate(candidates)}


def _share_at_least(values: Array) -> Array:
    """For each of values [R] the share of them that is as large or larger."""
    ascending = np.sort(values)
    return 1 - np.searchsorted(ascending, values * (1 - 1e-12), side="left") / len(values)


def _share_at_most(values: Array) -> Array:
    """For each of values [R] the share of them that is as small or smaller."""
    return np.searchsorted(np.sort(values), values, side="right") / len(values)


def held_out_gains(statistics: Statistics, nuisances: Array, candidate: Array, block: Array, seed: int) -> Array:
    """How much less each action's error becomes by the candidate when it is fitted to the other blocks, [n].

    To second order about the fitted model, with what the nuisances can do projected out once, over all actions: fitted
    anew in each fold, they would wander along what few strokes leave open. ``block`` [n] holds what is left out
    together.
    """
    fold = folds(block, seed)
    slope, curvature = projected(statistics, nuisances, candidate)
    gains = np.zeros(len(block))
    for k in range(_FOLDS):
        out = fold == k
        if out.all() or not out.any():
            continue
        known, pulls = curvature[~out].sum(0), slope[~out]
        # Of the order of what is typical: what strokes leave open is not learnt from their noise.
        noise = np.square(pulls).sum() / max(np.trace(known), 1e-300)
        step = np.linalg.lstsq(_ridged(known) + noise * np.eye(len(known)), pulls.sum(0), rcond=None)[0]
        gains[out] = 2 * slope[out] @ step - np.einsum("p,npq,q->n", step, curvature[out], step)
    return gains


def folds(block: Array, seed: int) -> Array:
    """Number of the fold of each action, int[n]; a block is never split."""
    blocks = np.unique(block)
    fold_of = dict(zip(blocks, np.random.default_rng([seed, 2]).permutation(len(blocks)) % _FOLDS, strict=True))
    return np.array([fold_of[b] for b in block])


def interval_of_mean(values: Array, draws: int, seed: int) -> tuple[float, float]:
    """95 % of the mean, by resampling actions."""
    return mean_and_bounds(values, draws, seed)[1]


def mean_and_bounds(values: Array, draws: int, seed: int) -> tuple[float, tuple[float, float], float]:
    """The mean, 95 % of it, and what it is at least (5 %, one-sided), by resampling actions."""
    means = values[resamples(len(values), draws, [seed, 3])].mean(1)
    return float(values.mean()), interval(means), float(np.quantile(means, 0.05))


def _ridged(curvature: Array) -> Array:
    diagonal = np.diag(curvature)
    return curvature + np.diag(_RIDGE * diagonal + 1e-15)


@dataclass(frozen=True)
class Step:
    """One round of the search."""

    evidence: dict[str, Evidence]
    """Of every candidate at the model so far; gains as shares of the error at that point."""
    chosen: str | None
    rivals: tuple[str, ...]
    """Causes whose refit in the chosen one's place is not worse at 5 %, paired by action."""


def most_parsimonious(
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
    minimum = min(losses, key=lambda cause: float(losses[cause].mean()))
    nearly = error - _NEARLY * (error - float(losses[minimum].mean()))
    tied = [c for c in losses if losses[c].mean() <= nearly or paired_p(losses[c] - losses[minimum], seed) >= _WORSE_P]
    chosen = min(tied, key=lambda c: (quantities[c], float(losses[c].mean())))
    rivals = tuple(cause for cause in tied if cause != chosen)
    log(f"{chosen}: error {losses[chosen].mean():.3g}" + (f", rivals {', '.join(rivals)}" if rivals else ""))
    return Step(evidence, chosen, rivals)


def unconfirmed(found: Sequence[str], confirmed_p: Mapping[str, float], beside_p: float) -> list[str]:
    """Causes, in the order in which they were found, that rows which were not searched do not confirm.

    For the first they must only speak. For a further one they must speak clearly (p of at most ``beside_p``): what the
    form of the first lacks looks like something.
    """
    limits = [_CONFIRMED_P, *[beside_p] * len(found)]
    return [cause for cause, limit in zip(found, limits, strict=False) if confirmed_p[cause] > limit]


def paired_p(differences: Array, seed: int) -> float:
    """One-sided p that the mean of ``differences`` [n] is not above 0: sign flips of what is left after centring."""
    n = len(differences)
    signs = np.random.default_rng([seed, 5]).choice((-1.0, 1.0), (_SIGN_FLIPS, n))
    observed = differences.mean() / max(differences.std(), 1e-300)
    flipped = signs * differences
    drawn = flipped.mean(1) / np.maximum(flipped.std(1), 1e-300)
    return float((1 + (drawn >= observed).sum()) / (_SIGN_FLIPS + 1))
