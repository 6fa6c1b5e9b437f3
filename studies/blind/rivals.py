"""Simpler ways to name causes, on the same rows: each from one linearisation of the fitted base with all candidates.

- ``pixels``: forward selection by the Bayesian information criterion (Schwarz 1978), every pixel as an observation.
- ``l1_path``: bounded least squares over all causes at once with an L1 penalty (Tibshirani 1996), which folds of blocks
  choose by the rule of one standard error; a cause counts from a tenth of its typical size on.
- ``posterior``: Bayesian comparison of all models with up to two causes, the action as unit, as model inference over
  components does (SBMI: Schröder and Macke 2024); a cause counts from an inclusion probability of one half on.
- ``distortion``: the score test of each cause as a distortion of the base, Holm's correction at 5 % (in the manner of
  Anau Montel, Alvey and Weniger 2025).
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from pentimento.diagnosis.gauss_newton import Statistics
from pentimento.diagnosis.problem import M, Problem
from pentimento.diagnosis.score import folds, projected_statistics
from pentimento.diagnosis.search import sign_flip_p

Array = NDArray[Any]

METHODS = ("pixels", "l1_path", "posterior", "distortion")
_P = 0.05
_SMALLEST = 0.1
"""Typical sizes from which a fitted cause counts."""
_PENALTIES = np.geomspace(1.0, 1e-3, 16)
"""Of the L1 path, as shares of the penalty at which every cause is 0."""


def named_by_rivals(problem: Problem[M], base: M, values_per_action: int) -> dict[str, tuple[str, ...]]:
    """The causes that each of ``METHODS`` names.

    Args:
        problem: rows with the learned residual.
        base: fitted to them, without causes.
        values_per_action: squared values in the error of one action.
    """
    candidates = [name for name, cause in problem.causes.items() if cause.named]
    statistics = problem.linearise(base, candidates)
    held, columns, at = np.arange(len(base.vector)), {}, len(base.vector)
    for name in candidates:
        columns[name] = np.arange(at, at + len(problem.causes[name].quantities))
        at += len(columns[name])
    signed = np.array([q.signed for name in candidates for q in problem.causes[name].quantities])
    block = problem.rows.block[problem.rows.first_of_action]
    return {
        "pixels": by_pixels(statistics, held, columns, values_per_action),
        "l1_path": by_l1_path(statistics, held, columns, signed=signed, block=block),
        "posterior": by_posterior(statistics, held, columns),
        "distortion": by_distortion(statistics, held, columns),
    }


def by_pixels(
    statistics: Statistics, held: Array, columns: Mapping[str, Array], values_per_action: int
) -> tuple[str, ...]:
    """Names of ``pixels``, in order of selection."""
    n = len(statistics.energy) * values_per_action
    chosen: list[str] = []
    now, best = held, n * np.log(_error(statistics, held))
    while len(chosen) < len(columns):
        costs = {
            cause: n * np.log(_error(statistics, np.concatenate([now, index]))) + len(index) * np.log(n)
            for cause, index in columns.items()
            if cause not in chosen
        }
        cause = min(costs, key=lambda c: float(costs[c]))
        if costs[cause] >= best:
            break
        chosen.append(cause)
        now = np.concatenate([now, columns[cause]])
        best = n * np.log(_error(statistics, now))
    return tuple(chosen)


def by_posterior(statistics: Statistics, held: Array, columns: Mapping[str, Array]) -> tuple[str, ...]:
    """Names of ``posterior``."""
    n = len(statistics.energy)
    models = [models for size in range(3) for models in combinations(columns, size)]
    costs = []
    for model in models:
        index = np.concatenate([held, *(columns[name] for name in model)])
        costs.append(n * np.log(_error(statistics, index)) + (len(index) - len(held)) * np.log(n))
    weight = np.exp(-(np.array(costs) - min(costs)) / 2)
    share = weight / weight.sum()
    return tuple(name for name in columns if sum(share[k] for k, m in enumerate(models) if name in m) >= 1 / 2)


def by_distortion(statistics: Statistics, held: Array, columns: Mapping[str, Array]) -> tuple[str, ...]:
    """Names of ``distortion``, the most significant first."""
    p = {}
    for name, index in columns.items():
        slope, curvature = projected_statistics(statistics, held, index)
        p[name] = sign_flip_p(slope, curvature.sum(0))
    named = []
    for rank, name in enumerate(sorted(p, key=lambda each: p[each])):
        if p[name] * (len(p) - rank) > _P:
            break
        named.append(name)
    return tuple(named)


def by_l1_path(
    statistics: Statistics, held: Array, columns: Mapping[str, Array], *, signed: Array, block: Array
) -> tuple[str, ...]:
    """Names of ``l1_path``.

    Args:
        statistics: in typical sizes.
        held: columns of the base.
        columns: of each candidate, in order.
        signed: whether each quantity may be below 0, bool[Q].
        block: of each action [n].
    """
    slope, curvature = projected_statistics(statistics, held, np.concatenate(list(columns.values())))
    fold = folds(block, 0)
    parts = np.unique(fold)
    gains = np.zeros((len(_PENALTIES), len(parts)))
    for k, part in enumerate(parts):
        out = fold == part
        path = _l1_path(slope[~out].sum(0), curvature[~out].sum(0), signed)
        for step, theta in enumerate(path):
            gains[step, k] = 2 * slope[out].sum(0) @ theta - theta @ curvature[out].sum(0) @ theta
    mean, error = gains.mean(1), gains.std(1) / np.sqrt(len(parts))
    best = int(np.argmax(mean))
    step = int(np.flatnonzero(mean >= mean[best] - error[best])[0])
    theta = _l1_path(slope.sum(0), curvature.sum(0), signed)[step]
    size = dict(zip(columns, np.split(np.abs(theta), np.cumsum([len(c) for c in columns.values()])[:-1]), strict=True))
    return tuple(name for name in columns if size[name].max() >= _SMALLEST)


def _l1_path(slope: Array, curvature: Array, signed: Array) -> list[Array]:
    """Minimisers of θᵀAθ - 2 bᵀθ + λ Σ|θ| for falling λ, from the largest that matters; unsigned θ are at least 0."""
    size = len(slope)
    bounds = [(0.0, None)] * size + [(0.0, None if each else 0.0) for each in signed]
    theta, path = np.zeros(2 * size), []  # θ = positive part - negative part
    for penalty in _PENALTIES * 2 * np.abs(slope).max():

        def cost(parts: Array, penalty: float = penalty) -> tuple[float, Array]:
            now = parts[:size] - parts[size:]
            pull = 2 * (curvature @ now - slope)
            return float(now @ curvature @ now - 2 * slope @ now + penalty * parts.sum()), np.concatenate(
                [pull + penalty, penalty - pull]
            )

        theta = minimize(cost, theta, jac=True, bounds=bounds, method="L-BFGS-B").x
        path.append(theta[:size] - theta[size:])
    return path


def _error(statistics: Statistics, index: Array) -> float:
    """Mean squared error of the linear model with these columns."""
    part = statistics.curvature.sum(0)[np.ix_(index, index)]
    ridged = part + np.diag(1e-9 * np.diag(part) + 1e-15)
    slope, energy = statistics.slope.sum(0)[index], float(statistics.energy.sum())
    return max(energy - float(slope @ np.linalg.solve(ridged, slope)), 1e-12 * energy) / len(statistics.energy)
