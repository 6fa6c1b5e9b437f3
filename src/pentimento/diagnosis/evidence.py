"""The evidence for a cause: a fixed vector of numbers that do not depend on the kind of actions.

Every number has one vote an action. The score of a cause in action i is u_i = s_i d + d A_i d, where d are its fitted
values, s_i and A_i the action's slope and curvature at the fitted model with all other parameters projected out. It is
the score against "no effect". a_i = u_i / (d A_i d) is the amount of the effect in that action; 1 is as fitted.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.gauss_newton import covariance
from pentimento.diagnosis.problem import Cause, M, Problem, columns_of, values_of
from pentimento.diagnosis.residual_structure import standardised
from pentimento.diagnosis.rule import DecisionRule
from pentimento.diagnosis.score import folds, paired_p, projected_statistics
from pentimento.diagnosis.search import held_out_losses, score_tests

Array = NDArray[Any]


class Evidence(NamedTuple):
    """Evidence for one cause of a model, as numbers of which the decision is made."""

    discovery_z: float
    """Its summed score on the discovery split, in standard errors."""
    confirmation_z: float
    """The same on the confirmation split, which did not choose it."""
    share: float
    """Error that it removes from actions that it was not fitted to, as a share of the error above the floor."""
    share_z: float
    """The same in standard errors."""
    votes: float
    """Share of the actions, weighted by how well they can show the effect, that deviate in its direction."""
    form_z: float
    """Largest dependence of the effect's amount on a covariate of the cause, in standard errors: 0 for a right form."""
    signature_z: float
    """Its most certain quantity, among those that it is named for, in standard errors."""
    unnamed: float
    """Held-out error that the best curve of one residual mode over one foreign covariate removes in its place, as a
    share of what the cause removes."""
    rival: float
    """Error that the best other cause removes in its place, as a share of what the cause removes."""
    beside: float
    """Its share beside that of the strongest cause of the model, 1 for the strongest."""
    misfit: float
    """Error of the model over the noise floor; 1 where the floor is unknown."""


class Examined(NamedTuple):
    """What was found about one cause of a model."""

    evidence: Evidence
    rivals: tuple[str, ...]
    """Other causes that remove as much in its place, or not surely less."""


def evidence_for(
    problem: Problem[M], model: M, confirmation: Array, rule: DecisionRule, *, gap: float, seed: int
) -> dict[str, Examined]:
    """Evidence for each cause of a model.

    Args:
        problem: discovery and confirmation split.
        model: with the causes, fitted to the discovery split.
        confirmation: whether an action belongs to the confirmation split, bool[n].
        rule: limits.
        gap: error of the base above the floor.
        seed: of folds.
    """
    fitted = problem.fit(model.causes, model)
    statistics = problem.linearise(model, ())
    spread = covariance(problem.linearise(fitted, ()))
    losses, floor = problem.losses(fitted), problem.floor(fitted)
    misfit = float(losses.mean()) / floor.mse if floor and floor.mse > 0 else 1.0
    found: dict[str, Examined] = {}
    for name in model.causes:
        cause, columns = problem.causes[name], columns_of(problem, model, name)
        rest = np.setdiff1d(np.arange(len(model.vector)), columns)
        slope, curvature = projected_statistics(statistics, rest, columns)
        values = model.vector[columns]
        weight = np.einsum("p,npq,q->n", values, curvature, values)
        score = slope @ values + weight
        without = problem.fit([other for other in model.causes if other != name], fitted)
        before = problem.losses(without)
        held_out = held_out_losses(problem, fitted, name, seed=seed)
        removed = before - held_out
        own = max(float(removed.mean()), 1e-300)
        signature = [i for i, q in enumerate(cause.quantities) if not cause.signature or q.name in cause.signature]
        errors = np.sqrt(np.maximum(np.diag(spread)[columns], 1e-300))
        rivals = _rivals(problem, without, model.causes, cause, rule=rule, seed=seed)
        evidence = Evidence(
            discovery_z=_z(score[~confirmation]),
            confirmation_z=_z(score[confirmation]),
            share=own / gap,
            share_z=_z(removed),
            votes=float((weight * (score > 0)).sum() / max(weight.sum(), 1e-300)),
            form_z=_form_z(problem, cause, score, weight),
            signature_z=float(np.max((np.abs(fitted.vector[columns]) / errors)[signature])),
            unnamed=_best_curve(problem, without, cause, seed) / own,
            rival=max([0.0, *(float((before - losses).mean()) for losses in rivals.values())]) / own,
            beside=1.0,
            misfit=misfit,
        )
        as_good = tuple(
            other
            for other, losses in rivals.items()
            if (before - losses).mean() >= rule.as_good_as * own or paired_p(losses - held_out, seed) >= rule.worse_p
        )
        found[name] = Examined(evidence, as_good)
    largest = max((e.evidence.share for e in found.values()), default=1.0)
    return {
        name: e._replace(evidence=e.evidence._replace(beside=e.evidence.share / largest)) for name, e in found.items()
    }


def _z(values: Array) -> float:
    """A sum in standard errors, by actions."""
    return float(values.sum() / max(np.sqrt(np.square(values).sum()), 1e-300))


def _form_z(problem: Problem[M], cause: Cause, score: Array, weight: Array) -> float:
    """Largest |z| of the slope of the effect's amount over a covariate of the cause."""
    rest, first = score - weight, problem.rows.first_of_action
    largest = 0.0
    for name in cause.covariates:
        if name not in problem.rows.covariates:
            continue
        column = problem.rows.covariates[name][first]
        centred = column - np.average(column, weights=np.maximum(weight, 1e-300))
        share = (weight * centred).sum() / max(weight.sum(), 1e-300)
        largest = max(largest, abs(_z(centred * rest - share * rest)))
    return largest


def _best_curve(problem: Problem[M], without: M, cause: Cause, seed: int) -> float:
    """Held-out error that the best quadratic curve of one mode over one covariate, foreign to the cause, removes."""
    foreign = {name: c for name, c in problem.rows.covariates.items() if name not in cause.covariates}
    scores = problem.mode_scores(without)
    robust = standardised(scores)
    fold = folds(problem.rows.block, seed)
    best = 0.0
    for column in foreign.values():
        line = (column - column.mean()) / max(column.std(), 1e-12)
        basis = np.stack([np.ones_like(line), line, line**2], axis=1)
        for m in range(scores.amounts.shape[1]):
            root = np.sqrt(robust.weight[:, m])
            fitted = np.zeros(len(line))
            for k in np.unique(fold):
                out = fold == k
                fit = np.linalg.lstsq((basis * root[:, None])[~out], (robust.amounts[:, m] * root)[~out], rcond=None)[0]
                fitted[out] = basis[out] @ fit
            amount, curve = robust.amounts[:, m] * robust.spread[m], fitted * robust.spread[m]
            best = max(best, float((scores.energy[:, m] * (amount**2 - (amount - curve) ** 2)).mean()))
    return best


def _rivals(
    problem: Problem[M], without: M, taken: tuple[str, ...], cause: Cause, *, rule: DecisionRule, seed: int
) -> dict[str, Array]:
    """Held-out error of each action, [n], with other causes in the place of one: the best of all and of its family."""
    others = [name for name in problem.causes if name not in taken]
    tests = score_tests(problem, without, others, seed=seed)
    ranked = sorted(others, key=lambda name: -tests[name].gain)
    family = [name for name in ranked if cause.family and problem.causes[name].family == cause.family]
    found = {}
    for name in dict.fromkeys([*ranked[: rule.rivals], *family[: rule.rivals]]):
        refit = problem.fit((*without.causes, name), without)
        if problem.causes[name].allows(values_of(problem, refit, name)):
            found[name] = held_out_losses(problem, refit, name, seed=seed)
    return found
