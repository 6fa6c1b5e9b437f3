"""Structure in what a model leaves: residual modes over covariates (docs/diagnosis.md §9).

A residual mode is a way in which an action deviates as a whole. Its amount in each row is weighted by certainty,
because a short or shallow action hardly shows some modes. Amounts are tested against covariates by permutation of
actions, with the maximum over all pairs (max-T). The strongest covariate is regressed out of all modes before the next
is sought, so that covariates that only correlate with it are not reported beside it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

Array = NDArray[Any]

DRAWS = 1999
"""Permutations of actions."""
SIGNIFICANT_P = 0.01
"""Significance level of a permutation test."""
_MAX_PAIRS = 6
"""Reported pairs of mode and covariate at most."""
_OUTLYING = 4
"""Scores are clipped at so many robust standard deviations."""
_MIN_SEEN = 50.0
"""Upper bound of a score's pixel variance, relative to the median one."""
_BINS = 7
"""Bins of a drawn dependence."""
_SHOWN = 6
"""Drawn dependences."""


@dataclass(frozen=True)
class ModeScores:
    """Amounts of M residual modes in B rows."""

    amounts: Array
    """[B, M] of each mode in each row's residual, in typical sizes."""
    energy: Array
    """[B, M] error of a row that one typical size of each mode makes: sRGB in [0, 1] squared, or mm²."""
    error: float
    """Mean error of the rows, in the same unit."""


class Unexplained(NamedTuple):
    """A residual mode that still depends on a covariate."""

    mode: str
    covariate: str
    p: float
    generic_gain: float
    """Share of the error that a generic function of the covariate in this mode would remove."""


@dataclass(frozen=True)
class Structure:
    """Dependence of M residual modes on C covariates."""

    unexplained: tuple[Unexplained, ...]
    """The significant pairs, strongest first."""
    strength: Array
    """[M, C] statistic |t| of every pair."""
    covariates: tuple[str, ...]
    """Names, [C]."""


def find_structure(
    modes: Sequence[str], scores: ModeScores, columns: Mapping[str, Array], *, action: Array, seed: int
) -> Structure:
    """Which modes depend on which covariates.

    Args:
        modes: names, [M].
        scores: of the modes.
        columns: covariates, [B] each, without gaps.
        action: rows of equal value repeat one command, [B].
        seed: of the permutations.
    """
    names = tuple(columns)
    if not names:
        return Structure((), np.zeros((len(modes), 0)), ())
    robust = standardised(scores)
    weight, root = robust.weight, np.sqrt(robust.weight)
    lines = np.stack([_standard(c) for c in columns.values()])  # [C, B]
    basis = np.stack([lines, np.stack([_standard(line**2) for line in lines])])
    whole = _strength(robust.amounts, weight, basis)
    found: list[Unexplained] = []
    left = robust.amounts
    while len(found) < _MAX_PAIRS:
        observed = _strength(left, weight, basis)
        rng = np.random.default_rng([seed, 9, len(found)])
        orders = permuted_actions(action, DRAWS, rng)
        largest = np.array([_strength(left[order], weight[order], basis).max() for order in orders])
        limit = np.quantile(largest, 1 - SIGNIFICANT_P)
        c = int(np.argmax(observed.max(0)))
        standing = np.flatnonzero(observed[:, c] >= limit)
        if not len(standing):
            break
        # One effect excites several modes: report the one whose dependence explains most of the error.
        gains = [
            _generic_gain(left[:, m] * robust.spread[m], scores.energy[:, m], basis[:, c].T) / scores.error
            for m in standing
        ]
        m = int(standing[int(np.argmax(gains))])
        p = float((1 + (largest >= observed[m, c]).sum()) / (DRAWS + 1))
        found.append(Unexplained(modes[m], names[c], p, float(max(gains))))
        one = np.column_stack([np.ones(len(left)), basis[:, c].T])
        left = np.stack([left[:, m] - one @ _least_squares(one, left[:, m], root[:, m]) for m in range(len(modes))], 1)
    return Structure(tuple(found), np.sqrt(whole), names)


@dataclass(frozen=True)
class Standardised:
    """Amounts of M modes in B rows on a common scale."""

    amounts: Array
    """[B, M] about the median, in robust standard deviations, outliers clipped."""
    weight: Array
    """[B, M], 1 on average in each mode."""
    spread: Array
    """[M] robust standard deviation, in typical sizes."""


def standardised(scores: ModeScores) -> Standardised:
    """The amounts on a common scale."""
    amounts = scores.amounts - np.median(scores.amounts, axis=0)
    spread = np.median(np.abs(amounts), axis=0) * 1.4826 + 1e-12
    amounts = amounts / spread
    weight = _certainty(amounts, scores.energy)
    root = np.sqrt(weight)
    return Standardised(np.clip(amounts * root, -_OUTLYING, _OUTLYING) / root, weight, spread)


def permuted_actions(action: Array, draws: int, rng: np.random.Generator) -> Array:
    """Row indices [draws, B] in which whole actions are exchanged for others with as many rows.

    Repeats of one command are correlated; permuting single rows would make shared structure look too certain.
    """
    rows = [np.flatnonzero(action == number) for number in np.unique(action)]
    order = np.tile(np.arange(len(action)), (draws, 1))
    for size in sorted({len(own) for own in rows}):
        same_size = np.stack([own for own in rows if len(own) == size])
        exchanged = rng.permuted(np.tile(np.arange(len(same_size)), (draws, 1)), axis=1)
        order[:, same_size] = same_size[exchanged]
    return order


def _certainty(scores: Array, energy: Array) -> Array:
    """Weights of scores [B, M]: the inverse of their variance, which has a part that is equal for all actions and a
    part that falls with the mode's energy (pixel noise). Non-negative least squares on the squared scores gives the two
    parts.
    """
    weight = np.empty_like(scores)
    for m, (score, own) in enumerate(zip(scores.T, energy.T, strict=True)):
        by_pixels = np.minimum(np.median(own) / np.maximum(own, 1e-12), _MIN_SEEN)
        expected = 1 / (1 + by_pixels)  # squares scatter in proportion to their mean
        shapes = np.stack([np.ones_like(by_pixels), by_pixels], axis=1)
        shares, _ = nnls(shapes * expected[:, None], np.clip(np.square(score), 0, _OUTLYING**2) * expected)
        weight[:, m] = 1 / np.maximum(shapes @ shares, 1e-6)
    return weight / weight.mean(0)


def _strength(scores: Array, weight: Array, basis: Array) -> Array:
    """Strength of each mode's weighted correlation with each covariate or its square, chi-squared [M, C].

    Args:
        scores: [B, M].
        weight: [B, M].
        basis: each covariate and its square, standardised, [2, C, B].
    """
    total, weighed = weight.sum(0), weight * scores
    mean = weighed.sum(0) / total
    spread = (weighed * scores).sum(0) - total * mean**2  # [M]
    at, with_scores = np.split(basis @ np.hstack([weight, weighed]), 2, axis=-1)  # [2, C, M]
    own = np.square(basis) @ weight - at**2 / total
    strength: Array = np.square(with_scores - at * mean) / np.maximum(own * spread, 1e-12)
    return strength.max(0).T * len(scores)


def _least_squares(basis: Array, values: Array, root_weight: Array) -> Array:
    """Coefficients [K] of [B, K] for values [B] with these square roots of weights."""
    found: Array = np.linalg.lstsq(basis * root_weight[:, None], values * root_weight, rcond=None)[0]
    return found


def _generic_gain(amount: Array, energy: Array, basis: Array) -> float:
    """Mean error that a quadratic function of the covariate would remove, to second order."""
    fitted = basis @ _least_squares(basis, amount, np.sqrt(energy))
    return float((energy * (amount**2 - (amount - fitted) ** 2)).mean())


def _standard(values: Array) -> Array:
    centred = values - values.mean(0)
    result: Array = centred / np.maximum(centred.std(0), 1e-12)
    return result


class Dependence(NamedTuple):
    """One residual mode over one covariate, in bins of equally many rows."""

    mode: str
    covariate: str
    centre: Array
    """[K] mean of the covariate in each bin."""
    base: Array
    """[K, 2] mean of the mode's amount in robust deviations, and half width of its 95 % band."""
    extended: Array


def mode_strength(amounts: Array, covariates: dict[str, Array]) -> Array:
    """sqrt(n) |r| of modes [B, M] with covariates or their squares, whichever is larger, [M, C]."""
    if not covariates:
        return np.zeros((amounts.shape[1], 0))
    y = _standard(np.clip(amounts, -4, 4))
    found = []
    for values in covariates.values():
        line = _standard(values)
        found.append(np.abs(np.stack([line, _standard(line**2)]) @ y).max(0) / len(y))
    return np.stack(found, axis=1) * np.sqrt(len(y))


def robust_deviations(scores: Array) -> Array:
    """Scores about their medians, in robust standard deviations."""
    centred = scores - np.median(scores, axis=0)
    deviations: Array = centred / (np.median(np.abs(centred), axis=0) * 1.4826 + 1e-12)
    return deviations


def dependences(
    modes: Sequence[str],
    base: Array,
    extended: Array,
    *,
    covariates: dict[str, Array],
    strengths: dict[str, Array],
    action: Array,
) -> tuple[Dependence, ...]:
    """The strongest pairs of mode and covariate in the base or extended model; each covariate at most twice."""
    names = list(covariates)
    scale = strengths["base"], strengths["extended"]
    ranked = sorted(
        ((float(max(s[m, c] for s in scale)), m, c) for m in range(base.shape[1]) for c in range(len(names))),
        reverse=True,
    )
    shown: list[Dependence] = []
    times: dict[int, int] = {}
    for _, m, c in ranked:
        if len(shown) == _SHOWN:
            break
        if times.get(c, 0) == 2:
            continue
        times[c] = times.get(c, 0) + 1
        values = covariates[names[c]]
        edges = np.unique(np.quantile(values, np.linspace(0, 1, _BINS + 1)))
        place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
        used = [k for k in range(len(edges) - 1) if (place == k).any()]
        centre = np.array([values[place == k].mean() for k in used])
        of_base, of_extended = (
            np.array([_mean_and_band(np.clip(amount[place == k, m], -6, 6), action[place == k]) for k in used])
            for amount in (base, extended)
        )
        shown.append(Dependence(modes[m], names[c], centre, of_base, of_extended))
    return tuple(shown)


def _mean_and_band(values: Array, action: Array) -> tuple[float, float]:
    """Mean over actions and 1.96 standard errors; NaN for a single action."""
    _, group, count = np.unique(action, return_inverse=True, return_counts=True)
    means = np.bincount(group, values) / count
    band = 1.96 * means.std(ddof=1) / np.sqrt(len(means)) if len(means) > 1 else np.nan
    return float(means.mean()), float(band)
