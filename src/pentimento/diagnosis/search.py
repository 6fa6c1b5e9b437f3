"""Forward selection of causes on the discovery split.

The search is liberal: it proposes causes, and the decision accepts or rejects them by their evidence (``decision``).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import gamma

from pentimento.diagnosis.evaluation import SMALLEST_GAP
from pentimento.diagnosis.problem import M, Problem, columns_of, values_of
from pentimento.diagnosis.rule import DecisionRule
from pentimento.diagnosis.score import held_out_gains, paired_p, projected_statistics

Array = NDArray[Any]


class Test(NamedTuple):
    """The score test of one candidate."""

    p: float
    """Adjusted for the number of candidates (Šidák)."""
    gain: float
    """Error that it removes from held-out actions, to second order."""


def search(
    problem: Problem[M], model: M, rule: DecisionRule, *, seed: int, log: Callable[[str], None], min_share: float
) -> M:
    """The model with further causes that explain its error.

    Args:
        problem: the discovery split.
        model: to start from.
        rule: limits.
        seed: of folds and sign flips.
        log: gets one line for each accepted cause.
        min_share: of the error above the floor, that a cause must remove.
    """
    needless: set[str] = set()
    dismissed: set[str] = set()
    while len(model.causes) < rule.most_causes:
        left = [name for name in problem.causes if name not in (*model.causes, *dismissed)]
        short = shortlist(score_tests(problem, model, left, seed=seed), problem, rule)
        if not short:
            break
        before = problem.losses(model)
        refits = {name: problem.fit((*model.causes, name), model) for name in short}
        refits = {n: r for n, r in refits.items() if problem.causes[n].allows(values_of(problem, r, n))}
        losses = {name: held_out_losses(problem, refit, name, seed=seed) for name, refit in refits.items()}
        least = min_share * above_floor(problem, model)
        useful = {
            name: after
            for name, after in losses.items()
            if (before - after).mean() >= least and paired_p(before - after, seed) < rule.entry_p
        }
        if not useful:
            dismissed |= set(short)
            continue
        chosen = simplest_of_the_best(useful, float(before.mean()), problem, rule, seed=seed)
        log(f"{chosen}: error {before.mean():.3g} -> {useful[chosen].mean():.3g}")
        model = without_needless(problem, refits[chosen], rule, seed=seed, log=log)
        needless |= {name for name in refits[chosen].causes if name not in model.causes}
        dismissed = set(needless)  # a candidate that did not help may help beside the new cause
    return model


def score_tests(problem: Problem[M], model: M, candidates: Sequence[str], *, seed: int) -> dict[str, Test]:
    """The score test of each candidate at a fitted model; one linearisation serves all."""
    if not candidates:
        return {}
    statistics = problem.linearise(model, candidates)
    nuisances = np.arange(len(model.vector))
    block = problem.rows.block[problem.rows.first_of_action]
    tests, at = {}, len(nuisances)
    for name in candidates:
        columns = np.arange(at, at + len(problem.causes[name].quantities))
        at += len(columns)
        slope, curvature = projected_statistics(statistics, nuisances, columns)
        p = sign_flip_p(slope, curvature.sum(0))
        gain = float(held_out_gains(statistics, nuisances, columns, block=block, seed=seed).mean())
        tests[name] = Test(1 - (1 - p) ** len(candidates), gain)
    return tests


def sign_flip_p(slope: Array, metric: Array) -> float:
    """p of the summed scores of actions [n, Q] in a metric [Q, Q], under random signs of whole actions.

    The statistic T = sum_ij s_i A^-1 s_j is a quadratic form in the signs. Its exact mean and variance under random
    signs give a gamma distribution, whose tail needs no draws (Satterthwaite's approximation).
    """
    scale = np.sqrt(np.maximum(np.diag(metric), 1e-300))
    unit = slope / scale
    ridged = metric / np.outer(scale, scale) + 1e-6 * np.eye(len(scale))
    products = unit @ np.linalg.solve(ridged, unit.T)  # [n, n]
    own = np.diag(products)
    mean, variance = own.sum(), 2 * (np.square(products).sum() - np.square(own).sum())
    if mean <= 0 or variance <= 0:
        return 1.0
    return float(gamma.sf(products.sum(), mean**2 / variance, scale=variance / mean))


def shortlist(tests: Mapping[str, Test], problem: Problem[M], rule: DecisionRule) -> list[str]:
    """Candidates to refit: the best significant one, those near it, and its family.

    The family is included because a large effect is far from linear and may show little in a test at 0.
    """
    standing = [name for name, test in tests.items() if test.p < rule.entry_p and test.gain > 0]
    if not standing:
        return []
    ranked = sorted(standing, key=lambda name: -tests[name].gain)
    near = [name for name in ranked if tests[name].gain >= rule.near_best * tests[ranked[0]].gain]
    family = problem.causes[ranked[0]].family
    relatives = [name for name in tests if family and problem.causes[name].family == family and name not in near]
    return near[: rule.refits] + sorted(relatives, key=lambda name: -tests[name].gain)[: rule.refits]


def held_out_losses(problem: Problem[M], model: M, cause: str, *, seed: int) -> Array:
    """Error of each action, [n], had the cause been fitted to the other folds of blocks only; to second order."""
    columns = columns_of(problem, model, cause)
    rest = np.setdiff1d(np.arange(len(model.vector)), columns)
    block = problem.rows.block[problem.rows.first_of_action]
    gains = held_out_gains(problem.linearise(model, ()), rest, columns, block=block, seed=seed)
    return problem.losses(model) - gains


def simplest_of_the_best(
    losses: Mapping[str, Array], error: float, problem: Problem[M], rule: DecisionRule, *, seed: int
) -> str:
    """The cause with the fewest quantities among those that explain as much as the best.

    A cause with many quantities can mimic a simple one and fit a little better, because no form is exact.

    Args:
        losses: of each candidate's refit, [n] by action.
        error: mean error before.
        problem: for the causes.
        rule: limits.
        seed: of the paired test.
    """
    best = min(losses, key=lambda name: float(losses[name].mean()))
    nearly = error - rule.as_good_as * (error - float(losses[best].mean()))
    tied = [
        name
        for name, each in losses.items()
        if each.mean() <= nearly or paired_p(each - losses[best], seed) >= rule.worse_p
    ]
    return min(tied, key=lambda name: (len(problem.causes[name].quantities), float(losses[name].mean())))


def without_needless(problem: Problem[M], model: M, rule: DecisionRule, *, seed: int, log: Callable[[str], None]) -> M:
    """The model without causes that it no longer needs beside its last one, or whose values became impossible."""
    for name in model.causes[:-1]:
        refit = problem.fit([other for other in model.causes if other != name], model)
        worse_p = paired_p(problem.losses(refit) - problem.losses(model), seed)
        if not problem.causes[name].allows(values_of(problem, model, name)) or worse_p > rule.worse_p:
            log(f"{name} is no longer needed")
            return without_needless(problem, refit, rule, seed=seed, log=log)
    return model


def above_floor(problem: Problem[M], model: M) -> float:
    """Mean error above the noise floor, at least a tenth of the error."""
    error, floor = float(problem.losses(model).mean()), problem.floor(model)
    return max(error - (floor.mse if floor else 0.0), SMALLEST_GAP * error)
