"""What is left when no known cause explains more: modes of the residual against everything that was recorded.

A mode is a way in which a mark can differ as a whole: amplitude, width, shifts along and across its path and along the
canvas's axes, blur. Each row's residual is projected on each mode, and the projections, weighted as they scatter (in
a short or shallow mark a mode is hardly seen), are tested against covariates by permutation of strokes, max-T over all
pairs. What the strongest covariate does is taken out of all modes before the
next is looked for: what merely goes along with it (time with wear, temperature with both) is not named beside it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

Array = NDArray[Any]

_DRAWS = 1999
_P = 0.01
_MAX_PAIRS = 6
_OUTLYING = 4
"""In usual deviations: beyond, a score counts as this much."""
_MIN_SEEN = 50.0
"""Times the usual variance: a mode that is seen less in a mark counts as this."""
_BINS = 7
_SHOWN = 6
_MIN_DRIFT = 0.05
"""Of the error: what is worth less may be what a base lacks where neighbours share a load of paint or a surface."""
_TINY = 1e-12


class Unexplained(NamedTuple):
    """A mode that still depends on a covariate."""

    mode: str
    covariate: str
    p: float
    generic_gain: float
    """Share of the error that a quadratic of the covariate in this mode would remove, to second order."""


def structure(
    modes: Sequence[str],
    scores: Array,
    energy: Array,
    error: float,
    columns: Mapping[str, Array],
    action: Array,
    seed: int,
) -> tuple[list[Unexplained], Array, list[str]]:
    """``unexplained`` for amounts of any modes.

    Args:
        modes: names, [M].
        scores: amount of each mode in each row's residual, in typical sizes, [B, M].
        energy: what one typical size of each is worth in the row's error, [B, M].
        error: mean over the rows.
        columns: what the modes may depend on, [B] each, without gaps.
        action: rows of one value repeat one command, [B].
        seed: of the permutations.
    """
    names = list(columns)
    if not names:
        return [], np.zeros((len(modes), 0)), []
    scores, weight, spread = levelled(scores, energy)
    root = np.sqrt(weight)
    lines = np.stack([_standard(c) for c in columns.values()])  # [C, B]
    basis = np.stack([lines, np.stack([_standard(line**2) for line in lines])])
    whole = _strength(scores, weight, basis)
    found: list[Unexplained] = []
    left = scores
    while len(found) < _MAX_PAIRS:
        observed = _strength(left, weight, basis)
        rng = np.random.default_rng([seed, 9, len(found)])
        orders = permuted_actions(action, _DRAWS, rng)
        largest = np.array([_strength(left[order], weight[order], basis).max() for order in orders])
        limit = np.quantile(largest, 1 - _P)
        c = int(np.argmax(observed.max(0)))
        standing = np.flatnonzero(observed[:, c] >= limit)
        if not len(standing):
            break
        # Neighbouring modes answer to one cause: the one by which it would explain most of the picture.
        gains = [_generic_gain(left[:, m] * spread[m], energy[:, m], basis[:, c].T) / error for m in standing]
        m = int(standing[int(np.argmax(gains))])
        p = float((1 + (largest >= observed[m, c]).sum()) / (_DRAWS + 1))
        found.append(Unexplained(modes[m], names[c], p, float(max(gains))))
        one = np.column_stack([np.ones(len(left)), basis[:, c].T])
        left = np.stack([left[:, m] - one @ _least_squares(one, left[:, m], root[:, m]) for m in range(len(modes))], 1)
    return found, np.sqrt(whole), names


def levelled(scores: Array, energy: Array) -> tuple[Array, Array, Array]:
    """Scores [B, M] about their median, in their usual deviation, outliers clipped; their weights [B, M], 1 on average;
    and the usual deviations [M].
    """
    scores = scores - np.median(scores, axis=0)
    spread = np.median(np.abs(scores), axis=0) * 1.4826 + 1e-12
    scores = scores / spread
    weight = _certainty(scores, energy)
    root = np.sqrt(weight)
    return np.clip(scores * root, -_OUTLYING, _OUTLYING) / root, weight, spread


def permuted_actions(action: Array, draws: int, rng: np.random.Generator) -> Array:
    """Row indices [draws, B] with whole actions exchanged for others of as many rows: repeats of one command are alike,
    and taken apart they would make what they share look surer than it is.
    """
    rows = [np.flatnonzero(action == number) for number in np.unique(action)]
    order = np.tile(np.arange(len(action)), (draws, 1))
    for size in sorted({len(own) for own in rows}):
        alike = np.stack([own for own in rows if len(own) == size])
        exchanged = rng.permuted(np.tile(np.arange(len(alike)), (draws, 1)), axis=1)
        order[:, alike] = alike[exchanged]
    return order


def _certainty(scores: Array, energy: Array) -> Array:
    """Weights of scores [B, M]: one over their variance, which is one for all, as actions differ, and one that falls
    with the mode's own energy, as the noise of pixels does; how much of each, their squares say.
    """
    weight = np.empty_like(scores)
    for m, (score, own) in enumerate(zip(scores.T, energy.T, strict=True)):
        by_pixels = np.minimum(np.median(own) / np.maximum(own, 1e-12), _MIN_SEEN)
        expected = 1 / (1 + by_pixels)  # squares scatter by themselves: what is larger says less
        shapes = np.stack([np.ones_like(by_pixels), by_pixels], axis=1)
        shares, _ = nnls(shapes * expected[:, None], np.clip(np.square(score), 0, _OUTLYING**2) * expected)
        weight[:, m] = 1 / np.maximum(shapes @ shares, 1e-6)
    return weight / weight.mean(0)


def _strength(scores: Array, weight: Array, basis: Array) -> Array:
    """How strongly each mode goes with each covariate, or with its square, chi-squared [M, C], by weighted correlation.

    Args:
        scores, weight: [B, M].
        basis: [2, C, B] each covariate, and its square.
    """
    total, weighed = weight.sum(0), weight * scores
    mean = weighed.sum(0) / total
    spread = (weighed * scores).sum(0) - total * mean**2  # [M]
    at, with_scores = np.split(basis @ np.hstack([weight, weighed]), 2, axis=-1)  # [2, C, M]
    own = np.square(basis) @ weight - at**2 / total
    strength: Array = np.square(with_scores - at * mean) / np.maximum(own * spread, 1e-12)
    return strength.max(0).T * len(scores)


def _least_squares(basis: Array, values: Array, root_weight: Array) -> Array:
    """Coefficients [K] of [B, K] for values [B] with these roots of weights."""
    found: Array = np.linalg.lstsq(basis * root_weight[:, None], values * root_weight, rcond=None)[0]
    return found


def _generic_gain(amount: Array, energy: Array, basis: Array) -> float:
    """Mean error that a quadratic of the covariate would remove, to second order."""
    fitted = basis @ _least_squares(basis, amount, np.sqrt(energy))
    return float((energy * (amount**2 - (amount - fitted) ** 2)).mean())


def _standard(values: Array) -> Array:
    centred = values - values.mean(0)
    result: Array = centred / np.maximum(centred.std(0), 1e-12)
    return result


class Dependence(NamedTuple):
    """How one mode of the residual goes with one covariate, in bins of equally many strokes."""

    mode: str
    covariate: str
    centre: Array
    """[K] of the covariate."""
    base: Array
    """[K, 2] mean of the mode's amount in typical sizes, and the half width of its 95 % band."""
    extended: Array


def mode_strength(amounts: Array, covariates: dict[str, Array]) -> Array:
    """How strongly modes [B, M] go with covariates, linearly or by their square: sqrt(n) |r|, [M, C]."""
    if not covariates:
        return np.zeros((amounts.shape[1], 0))
    y = _standard(np.clip(amounts, -4, 4))
    found = []
    for values in covariates.values():
        line = _standard(values)
        found.append(np.abs(np.stack([line, _standard(line**2)]) @ y).max(0) / len(y))
    return np.stack(found, axis=1) * np.sqrt(len(y))


def standing(scores: Array) -> Array:
    """Modes about their medians, in robust deviations."""
    centred = scores - np.median(scores, axis=0)
    deviations: Array = centred / (np.median(np.abs(centred), axis=0) * 1.4826 + 1e-12)
    return deviations


def dependences(
    modes: Sequence[str],
    base: Array,
    extended: Array,
    covariates: dict[str, Array],
    strengths: dict[str, Array],
    action: Array,
) -> tuple[Dependence, ...]:
    """The strongest pairs of the base, and of what is left, each covariate at most twice."""
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
    """Mean over actions and 1.96 of its standard errors; NaN where a single action says nothing of a spread."""
    _, group, count = np.unique(action, return_inverse=True, return_counts=True)
    means = np.bincount(group, values) / count
    band = 1.96 * means.std(ddof=1) / np.sqrt(len(means)) if len(means) > 1 else np.nan
    return float(means.mean()), float(band)


class TemporalDrift(NamedTuple):
    """A mode of the residual that wanders."""

    mode: str
    p: float
    mse: float
    """What it is worth: mean squared error of rows, sRGB in [0, 1] or mm²."""
    mse_of_repeats: float
    """How much of that the spread of repeats holds."""
    amount: Array
    """[B] of the mode in each row's residual, in robust standard deviations, in the order of execution."""


def temporal_drift(
    modes: Sequence[str], scores: Array, energy: Array, error: float, action: Array, turn: Array, seed: int
) -> TemporalDrift | None:
    """The mode in which neighbours in time are most alike, by permutation of actions, max-T over the modes; None where
    none is, beyond chance.

    Args:
        modes: names, [M].
        scores: amount of each mode in each row's residual, [B, M].
        energy: what one unit of each is worth in the row's error, [B, M].
        error: mean over the rows.
        action: rows of one value repeat one command, [B].
        turn: place of each row in the order of execution, 0 to B - 1, [B].
        seed: of the permutations.
    """
    amounts, weight, spread = levelled(scores, energy)
    amounts = amounts - (weight * amounts).sum(0) / weight.sum(0)
    order = np.argsort(turn)
    pairs = np.stack([order[:-1], order[1:]])
    pairs = pairs[:, action[pairs[0]] != action[pairs[1]]]  # else what an action's rows share would pass for it
    if not pairs.size:
        return None
    root = np.sqrt(weight)
    own = np.maximum(np.square(root * amounts).mean(0), _TINY)

    def alike(rows: Array) -> Array:
        return np.asarray((root * amounts)[rows[pairs]].prod(0).mean(0) / own)

    observed = alike(np.arange(len(action)))
    orders = permuted_actions(action, _DRAWS, np.random.default_rng([seed, 15]))
    largest = np.array([alike(rows).max() for rows in orders])
    m = int(np.argmax(observed))
    p = float((1 + (largest >= observed[m]).sum()) / (_DRAWS + 1))

    def worth(pairs: Array) -> float:
        weights = weight[:, m][pairs].prod(0)
        covariance = (weights * amounts[:, m][pairs].prod(0)).sum() / weights.sum()
        return max(float(covariance * spread[m] ** 2 * energy[:, m].mean()), 0.0)

    whole = worth(pairs)
    if p >= _P or whole <= _MIN_DRIFT * error:
        return None
    apart = _at_the_times_of_repeats(action, order)
    of_repeats = max(whole - worth(apart), 0.0) if apart.size else 0.0
    return TemporalDrift(modes[m], p, whole, of_repeats, amounts[order, m])


def _at_the_times_of_repeats(action: Array, order: Array) -> Array:
    """Pairs of rows [2, K], of other actions, that lie as far apart in time as repeats of one do: a repeat, and what
    came just before or after another.
    """
    place = np.argsort(order)
    found = []
    for number in np.unique(action):
        rows = np.flatnonzero(action == number)
        for one in rows:
            for other in rows[rows != one]:
                beside = [order[k] for k in (place[other] - 1, place[other] + 1) if 0 <= k < len(order)]
                found += [(one, row) for row in beside if action[row] != number]
    return np.array(found).T
