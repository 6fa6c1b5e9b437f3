"""Which causes a set of strokes can tell apart: the imitation matrix (docs/diagnosis.md §11).

Two causes imitate each other where their derivatives, less what the nuisances can take up, point the same way in the
space of all photographs. That is a property of the strokes' design: it takes commands and a model, and no photograph.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.stats import chi2, ncx2

from pentimento.diagnosis.gauss_newton import Statistics
from pentimento.diagnosis.score import project
from pentimento.diagnosis.verdict import Judged

Array = NDArray[Any]

ALIKE = 0.9
"""Above it, strokes can hardly tell two causes apart."""
_RIDGE = 1e-9
_UNSEEN = 1e-6
"""Of a cause's information: what must be left of it when the nuisances have taken their part."""
_FIRST_P = 0.02
_POWER = 0.8
_EXCHANGES = 10
_MIN_RISE = 1e-3
Question = tuple[str, ...]
"""Causes to be told apart, or one whose quantities are to be known better."""


class Aliasing(NamedTuple):
    """Of C causes."""

    causes: tuple[str, ...]
    cosine: Array
    """[C, C], 0 to 1: |cosine| of the two derivatives without the nuisances' part; for causes of more quantities the
    largest canonical correlation. NaN where the nuisances leave nothing of a cause."""

    def of(self, first: str, second: str) -> float:
        """One entry, by the causes' names."""
        return float(self.cosine[self.causes.index(first), self.causes.index(second)])

    @property
    def largest(self) -> float:
        """Of all pairs; 0 where there is none to compare."""
        pairs = self.cosine[np.tril_indices(len(self.causes), -1)]
        return float(np.max(pairs[np.isfinite(pairs)], initial=0.0))


class Columns(NamedTuple):
    """Where a model's Jacobian lists what."""

    nuisances: Array
    causes: dict[str, Array]


def information(curvature: Array, nuisances: Array, interest: Array) -> Array:
    """What strokes say of some numbers when the nuisances are free: the Schur complement, [Q, Q].

    Args:
        curvature: [P, P], summed over actions.
        nuisances: their indices.
        interest: indices of the Q numbers.
    """
    held = curvature[np.ix_(nuisances, nuisances)]
    held = held + np.diag(_RIDGE * np.diag(held) + 1e-15)
    cross = curvature[np.ix_(nuisances, interest)]
    left: Array = curvature[np.ix_(interest, interest)] - cross.T @ np.linalg.solve(held, cross)
    return (left + left.T) / 2


def aliasing(statistics: Statistics, columns: Columns) -> Aliasing:
    """The imitation matrix from statistics at a model."""
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


def sentences(found: Aliasing, alike: float = ALIKE) -> list[str]:
    """A sentence for each pair that can hardly be told apart, the closest first, and for each cause not seen at all."""
    said = [
        f"{first} and {second} imitate each other ({value:.2f}): this table can hardly tell them apart."
        for value, first, second in _closest(found, alike)
    ]
    return said + [f"{cause} leaves no trace in this table that the base could not leave." for cause in _unseen(found)]


def in_short(found: Aliasing, alike: float = ALIKE) -> str:
    """The same in one line, such as "tool_wear ~ drying_shift .97"; the closest pair where none is that close."""
    closest = _closest(found, alike)
    said = [f"{first} ~ {second} {value:.2f}".replace(" 0.", " .") for value, first, second in closest]
    if not said:
        nearest = [f"{first} ~ {second} {v:.2f}".replace(" 0.", " .") for v, first, second in _closest(found, 0.0)[:1]]
        said = [f"no two causes above {alike:.2f}".replace(" 0.", " .") + "".join(f" ({pair})" for pair in nearest)]
    return ", ".join(said + [f"no trace of {cause}" for cause in _unseen(found)])


def _closest(found: Aliasing, alike: float) -> list[tuple[float, str, str]]:
    """Pairs above a value, the closest first."""
    rows, cols = np.tril_indices(len(found.causes), -1)
    pairs = sorted(
        ((float(found.cosine[i, j]), i, j) for i, j in zip(rows, cols, strict=True) if found.cosine[i, j] > alike),
        reverse=True,
    )
    return [(value, found.causes[j], found.causes[i]) for value, i, j in pairs]


def _unseen(found: Aliasing) -> list[str]:
    return [cause for cause, own in zip(found.causes, np.diag(found.cosine), strict=True) if np.isnan(own)]


def _whitening(left: Array, own: Array) -> Array:
    """[Q, rank] with  W^T left W = 1, without directions that the nuisances take up."""
    scale = np.sqrt(np.maximum(own, 1e-300))
    values, vectors = np.linalg.eigh(left / np.outer(scale, scale))
    seen = values > _UNSEEN
    whitening: Array = vectors[:, seen] / np.sqrt(values[seen]) / scale[:, None]
    return whitening


def pairs_alike(found: Aliasing, causes: Mapping[str, Sequence[str]]) -> list[tuple[str, str]]:
    """Each named cause with its rivals and with what imitates it, as pairs without repeats.

    Args:
        causes: the rivals of each named cause.
    """
    pairs: list[tuple[str, str]] = []
    for cause, rivals in causes.items():
        alike = [other for other in found.causes if other != cause and found.of(cause, other) > ALIKE]
        for other in dict.fromkeys([*rivals, *alike]):
            if (other, cause) not in pairs:
                pairs.append((cause, other))
    return pairs


def detectable(statistics: Statistics, columns: Columns) -> dict[str, float]:
    """The smallest share of the error that each cause must remove to be found with a probability of 80 %.

    From the noncentral chi-squared law of its robust score test at the level of the first step, shared among all
    candidates (Bonferroni, so a little too careful). Infinite where the nuisances leave nothing of a cause.
    """
    level = _FIRST_P / max(len(columns.causes), 1)
    error, n = float(statistics.energy.mean()), len(statistics.energy)
    total = statistics.curvature.sum(0)
    found = {}
    for cause, index in columns.causes.items():
        degrees = len(index)
        threshold = float(chi2.isf(level, degrees))
        shift = float(brentq(lambda nc, d=degrees, t=threshold: ncx2.sf(t, d, nc) - _POWER, 1e-3, 1e4))
        scores = project(statistics, columns.nuisances, index)
        left = information(total, columns.nuisances, index)
        scale = np.sqrt(np.maximum(np.diag(left), 1e-300))
        spread = np.linalg.pinv(left / np.outer(scale, scale), rcond=1e-6, hermitian=True) @ (
            (scores / scale).T @ (scores / scale)
        )
        found[cause] = shift * float(np.trace(spread)) / degrees / n / max(error, 1e-300)
    return found


def questions(diagnosis: Judged, found: Aliasing) -> list[Question]:
    """What the next actions should decide.

    Named causes against their rivals and imitators; without any, the quantities of what is established; without that,
    the cause that the strokes spoke for most against what imitates it, or against the second.
    """
    named = {f.cause: f.rivals for f in (*diagnosis.established, *diagnosis.suspected)}
    known = set(found.causes)
    seen = {c: tuple(r for r in rivals if r in known) for c, rivals in named.items() if c in known}
    pairs: list[Question] = list(pairs_alike(found, seen))
    if pairs:
        return pairs
    if seen:
        return [(cause,) for cause in seen]
    evidence = diagnosis.search.steps[-1].evidence if diagnosis.search.steps else {}
    strongest = [cause for _, cause in sorted((e.p, cause) for cause, e in evidence.items() if cause in known)]
    if len(strongest) < 2:
        return []
    return list(pairs_alike(found, {strongest[0]: ()})) or [(strongest[0], strongest[1])]


def best_of_turns(so_far: Array, says: Array, columns: Columns, asked: Sequence[Question]) -> list[int]:
    """For each turn, which sequence's action: one after another the best, then exchanged while anything improves."""
    turns = range(says.shape[1])
    chosen: list[int] = []
    total = so_far.copy()
    for turn in turns:
        chosen.append(int(np.argmax(_worth(total + says[:, turn], columns, asked))))
        total += says[chosen[turn], turn]
    for _ in range(_EXCHANGES):
        changed = False
        for turn in turns:
            total -= says[chosen[turn], turn]
            values = _worth(total + says[:, turn], columns, asked)
            best = int(np.argmax(values))
            if values[best] > values[chosen[turn]] + _MIN_RISE:
                chosen[turn], changed = best, True
            total += says[chosen[turn], turn]
        if not changed:
            break
    return chosen


def worth(total: Array, columns: Columns, asked: Sequence[Question]) -> float:
    """Sum of log det S over the questions' causes, for a curvature [P, P] summed over all actions."""
    return float(_worth(total[None], columns, asked)[0])


def alike(total: Array, columns: Columns, pair: tuple[str, str]) -> float:
    """Largest canonical correlation of two causes' derivatives without the part of everything else in the model."""
    rest = [index for cause, index in columns.causes.items() if cause not in pair]
    held = Columns(np.concatenate([columns.nuisances, *rest]), {cause: columns.causes[cause] for cause in pair})
    nothing = np.zeros((1, len(total)))
    return aliasing(Statistics(total[None], nothing, nothing[:, 0]), held).of(*pair)


def _worth(totals: Array, columns: Columns, asked: Sequence[Question]) -> Array:
    """The same for curvatures [M, P, P]: [M]. log det of a Schur complement is a difference of two."""
    everything = np.arange(totals.shape[1])
    of_all = _log_det(totals, everything)
    worth = np.zeros(len(totals))
    for cause in (cause for question in asked for cause in question):
        worth += of_all - _log_det(totals, np.setdiff1d(everything, columns.causes[cause]))
    return worth


def _log_det(totals: Array, index: Array) -> Array:
    """Of parts of [M, P, P], [M]; a hundred-millionth more on the diagonal, for what nothing depends on."""
    own = np.maximum(np.einsum("mpp->mp", totals)[:, index], 1e-150)  # whose square is still a number
    scaled = totals[:, index][:, :, index] / np.sqrt(own[:, :, None] * own[:, None, :])
    log_det: Array = np.linalg.slogdet(scaled + 1e-8 * np.eye(len(index)))[1] + np.log(own).sum(1)
    return log_det


def says_most_about(total: Array, says: Array, columns: Columns, asked: Sequence[Question]) -> Question:
    """The question on which most is lost without the action."""
    lost = [worth(total, columns, [q]) - worth(total - says, columns, [q]) for q in asked]
    return asked[int(np.argmax(lost))]
