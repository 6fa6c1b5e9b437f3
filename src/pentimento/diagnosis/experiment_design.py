"""What a design of actions can tell apart: aliasing of causes, detectable effect size, D_s-optimal further actions.

Two causes are aliased where their Jacobians, with the nuisances projected out, point the same way. That depends on the
commands and the model, not on the measurements (docs/diagnosis.md §11).

The information about a cause with everything else free is the Schur complement S of its curvature. It is small where a
rival can take the cause's place. A D_s-optimal design (Atkinson, Donev and Tobias 2007, ch. 10) raises the sum of log
det S over the causes in question. Actions are chosen greedily, then exchanged (Fedorov 1972).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.stats import chi2, ncx2

from pentimento.diagnosis.diagnose import Result
from pentimento.diagnosis.gauss_newton import Statistics
from pentimento.diagnosis.problem import M
from pentimento.diagnosis.rule import DEFAULT_RULE
from pentimento.diagnosis.score import projected_scores

Array = NDArray[Any]

ALIASED = 0.9
"""Canonical correlation above which a design can hardly tell two causes apart."""
_RIDGE = 1e-9
_UNSEEN = 1e-6
"""Share of a cause's information that must be left with the nuisances free."""
_POWER = 0.8
"""Probability with which the search's score test finds a detectable effect."""
_EXCHANGES = 10
"""Rounds of exchange at most."""
_MIN_RISE = 1e-3
"""Rise of log det S for which an action is exchanged."""
Question = tuple[str, ...]
"""Causes to be told apart, or one cause whose quantities should be known better."""


class Aliasing(NamedTuple):
    """Aliasing matrix of C causes."""

    causes: tuple[str, ...]
    cosine: Array
    """[C, C], 0 to 1: largest canonical correlation of two causes with the nuisances projected out (|cosine| for single
    quantities). NaN where the nuisances leave nothing of a cause."""

    def of(self, first: str, second: str) -> float:
        """The entry of two causes, by name."""
        return float(self.cosine[self.causes.index(first), self.causes.index(second)])

    @property
    def largest(self) -> float:
        """The largest value of all pairs; 0 where no pair can be compared."""
        pairs = self.cosine[np.tril_indices(len(self.causes), -1)]
        return float(np.max(pairs[np.isfinite(pairs)], initial=0.0))


class Columns(NamedTuple):
    """Indices of nuisances and causes in a model's Jacobian."""

    nuisances: Array
    causes: dict[str, Array]


def information(curvature: Array, nuisances: Array, interest: Array) -> Array:
    """Information about some parameters with the nuisances free: the Schur complement, [Q, Q].

    Args:
        curvature: [P, P], summed over actions.
        nuisances: their indices.
        interest: indices of the Q parameters.
    """
    held = curvature[np.ix_(nuisances, nuisances)]
    held = held + np.diag(_RIDGE * np.diag(held) + 1e-15)
    cross = curvature[np.ix_(nuisances, interest)]
    left: Array = curvature[np.ix_(interest, interest)] - cross.T @ np.linalg.solve(held, cross)
    return (left + left.T) / 2


def aliasing(statistics: Statistics, columns: Columns) -> Aliasing:
    """The aliasing matrix from statistics at a model."""
    names = tuple(columns.causes)
    index = np.concatenate([columns.causes[name] for name in names]) if names else np.zeros(0, int)
    total = statistics.curvature.sum(0)
    left = information(total, columns.nuisances, index)
    own = total[index, index]
    at = np.cumsum([0, *(len(columns.causes[name]) for name in names)])
    parts = [slice(first, last) for first, last in pairwise(at)]
    whitening = [_whitening(left[part, part], own[part]) for part in parts]
    cosine = np.eye(len(names))
    for i, of_i in enumerate(whitening):
        if of_i.shape[1] == 0:
            cosine[i] = cosine[:, i] = np.nan
    for i in range(len(names)):
        for j in range(i):
            if np.isfinite(cosine[i, j]):
                shared = whitening[i].T @ left[parts[i], parts[j]] @ whitening[j]
                cosine[i, j] = cosine[j, i] = min(float(np.linalg.norm(shared, 2)), 1.0)
    return Aliasing(names, cosine)


def aliasing_sentences(found: Aliasing, above: float = ALIASED) -> list[str]:
    """A sentence for each aliased pair, the closest first, and for each cause that the nuisances hide completely."""
    lines = [
        f"{first} and {second} are aliased ({value:.2f}): this table can hardly tell them apart."
        for value, first, second in _closest(found, above)
    ]
    return lines + [f"{cause} has no effect in this table that the base could not absorb." for cause in _unseen(found)]


def aliasing_in_short(found: Aliasing, above: float = ALIASED) -> str:
    """The same in one line, such as "tool_wear ~ drying_shift .97"; the closest pair where none is aliased."""
    closest = _closest(found, above)
    lines = [f"{first} ~ {second} {value:.2f}".replace(" 0.", " .") for value, first, second in closest]
    if not lines:
        nearest = [f"{first} ~ {second} {v:.2f}".replace(" 0.", " .") for v, first, second in _closest(found, 0.0)[:1]]
        lines = [f"no two causes above {above:.2f}".replace(" 0.", " .") + "".join(f" ({pair})" for pair in nearest)]
    return ", ".join(lines + [f"{cause} not identifiable" for cause in _unseen(found)])


def _closest(found: Aliasing, above: float) -> list[tuple[float, str, str]]:
    """Pairs above a value, the closest first."""
    rows, cols = np.tril_indices(len(found.causes), -1)
    pairs = sorted(
        ((float(found.cosine[i, j]), i, j) for i, j in zip(rows, cols, strict=True) if found.cosine[i, j] > above),
        reverse=True,
    )
    return [(value, found.causes[j], found.causes[i]) for value, i, j in pairs]


def _unseen(found: Aliasing) -> list[str]:
    return [cause for cause, own in zip(found.causes, np.diag(found.cosine), strict=True) if np.isnan(own)]


def _whitening(left: Array, own: Array) -> Array:
    """W [Q, rank] with W^T left W = 1, without directions that the nuisances absorb."""
    scale = np.sqrt(np.maximum(own, 1e-300))
    values, vectors = np.linalg.eigh(left / np.outer(scale, scale))
    seen = values > _UNSEEN
    whitening: Array = vectors[:, seen] / np.sqrt(values[seen]) / scale[:, None]
    return whitening


def aliased_pairs(found: Aliasing, causes: Mapping[str, Sequence[str]]) -> list[tuple[str, str]]:
    """Each named cause with its rivals and its aliased causes, as pairs without repeats.

    Args:
        causes: the rivals of each named cause.
    """
    pairs: list[tuple[str, str]] = []
    for cause, rivals in causes.items():
        aliased = [other for other in found.causes if other != cause and found.of(cause, other) > ALIASED]
        for other in dict.fromkeys([*rivals, *aliased]):
            if (other, cause) not in pairs:
                pairs.append((cause, other))
    return pairs


def detectable(statistics: Statistics, columns: Columns) -> dict[str, float]:
    """The smallest share of the error that each cause must remove for its score test to find it with ``_POWER``.

    From the noncentral chi-squared law of the robust score test at ``DecisionRule.entry_p``, Bonferroni-corrected,
    which is slightly conservative. Infinite where the nuisances leave nothing of a cause.
    """
    level = DEFAULT_RULE.entry_p / max(len(columns.causes), 1)
    error, n = float(statistics.energy.mean()), len(statistics.energy)
    total = statistics.curvature.sum(0)
    found = {}
    for cause, index in columns.causes.items():
        degrees = len(index)
        threshold = float(chi2.isf(level, degrees))
        shift = float(brentq(lambda nc, d=degrees, t=threshold: ncx2.sf(t, d, nc) - _POWER, 1e-3, 1e4))
        scores = projected_scores(statistics, columns.nuisances, index)
        left = information(total, columns.nuisances, index)
        scale = np.sqrt(np.maximum(np.diag(left), 1e-300))
        spread = np.linalg.pinv(left / np.outer(scale, scale), rcond=1e-6, hermitian=True) @ (
            (scores / scale).T @ (scores / scale)
        )
        found[cause] = shift * float(np.trace(spread)) / degrees / n / max(error, 1e-300)
    return found


def questions(result: Result[M], found: Aliasing) -> list[Question]:
    """What the next actions should decide.

    Named causes against their rivals and aliased causes. Without such pairs: the quantities of the named causes.
    Without named causes: the strongest candidate against what it is aliased with, or against the second strongest.
    """
    named = {f.cause: f.rivals for f in (*result.established, *result.suspected)}
    known = set(found.causes)
    seen = {c: tuple(r for r in rivals if r in known) for c, rivals in named.items() if c in known}
    pairs: list[Question] = list(aliased_pairs(found, seen))
    if pairs:
        return pairs
    if seen:
        return [(cause,) for cause in seen]
    strongest = sorted((c for c in result.others if c in known), key=lambda c: result.others[c].p)
    if len(strongest) < 2:
        return []
    return list(aliased_pairs(found, {strongest[0]: ()})) or [(strongest[0], strongest[1])]


def greedy_exchange(so_far: Array, gains: Array, columns: Columns, asked: Sequence[Question]) -> list[int]:
    """For each turn, the index of the sequence that provides its action: chosen greedily, then exchanged."""
    turns = range(gains.shape[1])
    chosen: list[int] = []
    total = so_far.copy()
    for turn in turns:
        chosen.append(int(np.argmax(_design_values(total + gains[:, turn], columns, asked))))
        total += gains[chosen[turn], turn]
    for _ in range(_EXCHANGES):
        changed = False
        for turn in turns:
            total -= gains[chosen[turn], turn]
            values = _design_values(total + gains[:, turn], columns, asked)
            best = int(np.argmax(values))
            if values[best] > values[chosen[turn]] + _MIN_RISE:
                chosen[turn], changed = best, True
            total += gains[chosen[turn], turn]
        if not changed:
            break
    return chosen


def design_value(total: Array, columns: Columns, asked: Sequence[Question]) -> float:
    """Sum of log det S over the questions' causes, for a curvature [P, P] summed over all actions."""
    return float(_design_values(total[None], columns, asked)[0])


def pair_aliasing(total: Array, columns: Columns, pair: tuple[str, str]) -> float:
    """Largest canonical correlation of two causes with everything else in the model projected out."""
    rest = [index for cause, index in columns.causes.items() if cause not in pair]
    held = Columns(np.concatenate([columns.nuisances, *rest]), {cause: columns.causes[cause] for cause in pair})
    nothing = np.zeros((1, len(total)))
    return aliasing(Statistics(total[None], nothing, nothing[:, 0]), held).of(*pair)


def _design_values(totals: Array, columns: Columns, asked: Sequence[Question]) -> Array:
    """``design_value`` of curvatures [M, P, P]: [M]. log det of a Schur complement is a difference of two log dets."""
    everything = np.arange(totals.shape[1])
    of_all = _log_det(totals, everything)
    worth = np.zeros(len(totals))
    for cause in (cause for question in asked for cause in question):
        worth += of_all - _log_det(totals, np.setdiff1d(everything, columns.causes[cause]))
    return worth


def _log_det(totals: Array, index: Array) -> Array:
    """log det of submatrices of [M, P, P], [M], with a small ridge for parameters that nothing depends on."""
    own = np.maximum(np.einsum("mpp->mp", totals)[:, index], 1e-150)  # whose square is above 0 in float64
    scaled = totals[:, index][:, :, index] / np.sqrt(own[:, :, None] * own[:, None, :])
    log_det: Array = np.linalg.slogdet(scaled + 1e-8 * np.eye(len(index)))[1] + np.log(own).sum(1)
    return log_det


def most_informed_question(total: Array, gains: Array, columns: Columns, asked: Sequence[Question]) -> Question:
    """The question that loses most without the action."""
    lost = [design_value(total, columns, [q]) - design_value(total - gains, columns, [q]) for q in asked]
    return asked[int(np.argmax(lost))]
