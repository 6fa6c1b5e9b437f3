"""Evidence for candidate causes from sums by action, and the parsimonious choice among refitted candidates.

The action is the unit, because pixels of one action share their errors. At the fitted model the projected score of a
candidate is s_i = g_ic - A_cb A_bb^-1 g_ib for each action, with the nuisances b projected out. Its signs can be
flipped at random without any refit (Rademacher wild bootstrap: Cameron, Gelbach and Miller 2008; Roodman et al. 2019).
The smallest p over all candidates gives the adjusted p (min-P: Westfall and Young 1993).
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
"""Relative ridge of linear systems."""
_FOLDS = 6
"""Folds of blocks for held-out gains."""
_SIGN_FLIPS = 4999
"""Draws of a wild bootstrap or a paired test."""
RESAMPLES = 999
"""Resamples of the bounds of a gain."""
Scale = Callable[[Array, Array], Array]
"""Maps projected slope [n, Q] and curvature [n, Q, Q] of the actions to the metric [Q, Q] of the summed score."""
_WORSE_P = 0.05
"""Paired p below which a refit is worse than the best one."""
_CONFIRMED_P = 0.4
"""Confirmation p up to which the first cause is confirmed."""
_NEARLY = 0.95
"""A candidate that removes this share of what the best one removes counts as tied with it, even if surely worse."""


class Evidence(NamedTuple):
    """Evidence for one candidate."""

    p: float
    """p of its own score test."""
    p_adjusted: float
    """p adjusted for all candidates tested together."""
    gain: float
    """Error that it removes from held-out actions, to second order, as a share of the model's error."""
    gain_interval: tuple[float, float]
    """95 % interval of the gain."""
    min_gain: float
    """Lower bound of the gain, 5 %, one-sided."""


def information(slope: Array, curvature: Array) -> Array:
    """The information matrix as metric: the statistic is the error that the candidate would remove.

    It is not divided by the scatter of the scores. The sign flips give the null distribution, and where few actions
    show a cause that scatter is the effect itself.
    """
    total: Array = curvature.sum(0)
    return total


def scatter(slope: Array, curvature: Array) -> Array:
    """The scatter of the scores as metric: a robust (Wald) statistic.

    It suits candidates of which some quantities carry much random variation by action and others little.
    """
    return slope.T @ slope


def evidence_for(
    statistics: Statistics,
    nuisances: int,
    quantities: Mapping[str, int],
    *,
    block: Array,
    seed: int,
    scales: Sequence[Scale] = (information,),
) -> dict[str, Evidence]:
    """Evidence for each candidate at a fitted model.

    Args:
        statistics: of the model's own parameters, the ``nuisances``, followed by those of all candidates.
        nuisances: number of the model's own parameters.
        quantities: number of parameters of each candidate, in their order.
        block: block of each action [n]; a block is left out as a whole.
        seed: of sign flips, folds and resampling.
        scales: metrics of the statistic; the one with the smaller p counts.
    """
    held = np.arange(nuisances)
    index = _columns(nuisances, quantities)
    tests = score_tests(statistics, held, index, draws=_SIGN_FLIPS, seed=seed, scales=scales)
    error = float(statistics.energy.mean())
    evidence = {}
    for cause, columns in index.items():
        gains = held_out_gains(statistics, held, columns, block=block, seed=seed) / error
        p, adjusted = tests[cause]
        evidence[cause] = Evidence(p, adjusted, *mean_over_actions(gains, RESAMPLES, seed))
    return evidence


def statistics_with_each(
    statistics: Statistics, nuisances: int, quantities: Mapping[str, int]
) -> dict[str, Statistics]:
    """The statistics of the model with each candidate alone; arguments as for ``evidence_for``."""
    own = np.arange(nuisances)
    columns = _columns(nuisances, quantities)
    return {cause: statistics.of(np.concatenate([own, its])) for cause, its in columns.items()}


def _columns(nuisances: int, quantities: Mapping[str, int]) -> dict[str, Array]:
    """Indices of the parameters of each candidate."""
    ends = nuisances + np.cumsum(list(quantities.values()))
    return {cause: np.arange(end - quantities[cause], end) for cause, end in zip(quantities, ends, strict=True)}


def projected_scores(statistics: Statistics, nuisances: Array, candidate: Array) -> Array:
    """Scores [n, Q] of a candidate's parameters with the nuisances projected out."""
    pull = _nuisance_response(statistics, nuisances, candidate)
    projected: Array = statistics.slope[:, candidate] - statistics.slope[:, nuisances] @ pull
    return projected


def projected_statistics(statistics: Statistics, nuisances: Array, candidate: Array) -> tuple[Array, Array]:
    """Slope [n, Q] and curvature [n, Q, Q] of each action in a candidate's parameters, nuisances projected out."""
    pull = _nuisance_response(statistics, nuisances, candidate)
    slope = statistics.slope[:, candidate] - statistics.slope[:, nuisances] @ pull
    absorbed = pull.T @ statistics.curvature[:, nuisances][:, :, candidate]
    curvature = statistics.curvature[:, candidate][:, :, candidate] - absorbed - absorbed.swapaxes(1, 2)
    curvature += pull.T @ statistics.curvature[:, nuisances][:, :, nuisances] @ pull
    return slope, curvature


def _nuisance_response(statistics: Statistics, nuisances: Array, candidate: Array) -> Array:
    """Change of the nuisances per change of the candidate's parameters, [nuisances, candidate]."""
    curvature = statistics.curvature.sum(0)
    held = curvature[np.ix_(nuisances, nuisances)]
    return np.asarray(np.linalg.lstsq(_ridged(held), curvature[np.ix_(nuisances, candidate)], rcond=None)[0])


def score_statistic(pulls: Array, scale: Array) -> Array:
    """The statistic [R] for summed scores ``pulls`` [R, Q] in the metric ``scale`` [Q, Q]."""
    each = np.sqrt(np.maximum(np.diag(scale), 1e-300))
    scaled = pulls / each
    removed: Array = np.einsum("rq,qr->r", scaled, np.linalg.solve(_ridged(scale / np.outer(each, each)), scaled.T))
    return removed


def score_tests(
    statistics: Statistics,
    nuisances: Array,
    candidates: Mapping[str, Array],
    *,
    draws: int,
    seed: int,
    scales: Sequence[Scale] = (information,),
) -> dict[str, tuple[float, float]]:
    """(p, adjusted p) of each candidate by the wild bootstrap over actions.

    Candidates are compared by p, not by statistic: statistics that depend on few actions have longer tails. Of several
    ``scales`` the smaller p counts, in every draw.
    """
    n = len(statistics.energy)
    signs = np.concatenate([np.ones((1, n)), np.random.default_rng([seed, 1]).choice((-1.0, 1.0), (draws, n))])
    p = np.empty((len(candidates), draws + 1))  # in the first column as observed
    for c, index in enumerate(candidates.values()):
        slope, curvature = projected_statistics(statistics, nuisances, index)
        by_each = [_share_at_least(score_statistic(signs @ slope, scale(slope, curvature))) for scale in scales]
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


def held_out_gains(statistics: Statistics, nuisances: Array, candidate: Array, *, block: Array, seed: int) -> Array:
    """By how much the candidate lowers each action's error [n] when it is fitted to the other folds.

    To second order about the fitted model. The nuisances are projected out once, over all actions, because refits
    within a fold would move along directions that few actions determine.
    """
    fold = folds(block, seed)
    slope, curvature = projected_statistics(statistics, nuisances, candidate)
    gains = np.zeros(len(block))
    for k in range(_FOLDS):
        out = fold == k
        if out.all() or not out.any():
            continue
        known, pulls = curvature[~out].sum(0), slope[~out]
        # A ridge of the size of the noise: directions without information are not fitted to noise.
        noise = np.square(pulls).sum() / max(np.trace(known), 1e-300)
        step = np.linalg.lstsq(_ridged(known) + noise * np.eye(len(known)), pulls.sum(0), rcond=None)[0]
        gains[out] = 2 * slope[out] @ step - np.einsum("p,npq,q->n", step, curvature[out], step)
    return gains


def folds(block: Array, seed: int) -> Array:
    """Fold number of each action, int[n]; a block is never split."""
    blocks = np.unique(block)
    fold_of = dict(zip(blocks, np.random.default_rng([seed, 2]).permutation(len(blocks)) % _FOLDS, strict=True))
    return np.array([fold_of[b] for b in block])


class Mean(NamedTuple):
    """A mean over actions with bootstrap bounds."""

    value: float
    interval: tuple[float, float]
    """95 %."""
    minimum: float
    """Lower bound, 5 %, one-sided."""


def mean_over_actions(values: Array, draws: int, seed: int) -> Mean:
    """The mean of ``values`` [n] of actions, with bounds from so many ``draws`` of actions."""
    means = values[resamples(len(values), draws, [seed, 3])].mean(1)
    return Mean(float(values.mean()), interval(means), float(np.quantile(means, 0.05)))


def _ridged(curvature: Array) -> Array:
    diagonal = np.diag(curvature)
    return curvature + np.diag(_RIDGE * diagonal + 1e-15)


@dataclass(frozen=True)
class Step:
    """One round of forward selection."""

    evidence: dict[str, Evidence]
    """Of every candidate at the model so far."""
    chosen: str | None
    """The accepted cause; None in the last round."""
    rivals: tuple[str, ...]
    """Indistinguishable alternatives: causes whose refit in the chosen one's place is not worse at 5 %, paired by
    action."""


def most_parsimonious(
    evidence: dict[str, Evidence],
    losses: Mapping[str, Array],
    error: float,
    *,
    quantities: Mapping[str, int],
    seed: int,
    log: Callable[[str], None],
) -> Step:
    """Choose the cause with the fewest quantities among those that explain as much as the best; the others are its
    rivals.

    A cause explains as much if its refit is not worse at 5 %, or removes nearly as much of the error. A cause with many
    quantities can mimic a simple one and fit a little better, because no cause's functional form is exact.

    Args:
        evidence: of all candidates, kept in the step.
        losses: error of each action [n] with each refitted cause.
        error: mean error before.
        quantities: number of quantities of each cause.
        seed: of the paired test.
        log: gets one line.
    """
    minimum = min(losses, key=lambda cause: float(losses[cause].mean()))
    nearly = error - _NEARLY * (error - float(losses[minimum].mean()))
    tied = [c for c in losses if losses[c].mean() <= nearly or paired_p(losses[c] - losses[minimum], seed) >= _WORSE_P]
    chosen = min(tied, key=lambda c: (quantities[c], float(losses[c].mean())))
    rivals = tuple(cause for cause in tied if cause != chosen)
    log(f"{chosen}: error {losses[chosen].mean():.3g}" + (f", rivals {', '.join(rivals)}" if rivals else ""))
    return Step(evidence, chosen, rivals)


def unconfirmed(found: Sequence[str], confirmed_p: Mapping[str, float], beside_p: float) -> list[str]:
    """The causes, in the order in which they were found, that the confirmation split does not support.

    The first needs p <= 0.4. Further ones need p <= ``beside_p``, because the error of the first one's form can look
    like another cause.
    """
    limits = [_CONFIRMED_P, *[beside_p] * len(found)]
    return [cause for cause, limit in zip(found, limits, strict=False) if confirmed_p[cause] > limit]


def paired_p(differences: Array, seed: int) -> float:
    """One-sided p that the mean of ``differences`` [n] is not above 0, by sign flips."""
    n = len(differences)
    signs = np.random.default_rng([seed, 5]).choice((-1.0, 1.0), (_SIGN_FLIPS, n))
    observed = differences.mean() / max(differences.std(), 1e-300)
    flipped = signs * differences
    drawn = flipped.mean(1) / np.maximum(flipped.std(1), 1e-300)
    return float((1 + (drawn >= observed).sum()) / (_SIGN_FLIPS + 1))
