"""What answers say: exact tests of preferences and matches; a panel's agreement, and its means.

Answers of one rater, and answers about one picture, are not independent. Each result therefore names its unit: the
answers hold for these raters and these pictures, the raters for other raters, the pictures for other pictures.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta, binomtest, f, permutation_test, t

from pentimento.contracts.errors import ContractError
from pentimento.rating.answers import Answer
from pentimento.rating.page import Key

_LEVEL: Final = 0.95
_RESAMPLES: Final = 9999
"""Of the permutation test; up to 13 units it is exact."""


@dataclass(frozen=True)
class Proportion:
    """How often one of two outcomes occurred, against chance."""

    hits: int
    of: int
    share: float
    interval: tuple[float, float]
    """95 %, Clopper and Pearson (1934)."""
    p: float
    """Exact binomial test against chance."""


@dataclass(frozen=True)
class Preference:
    """The first condition against another one, on one question."""

    question: str
    first: str
    other: str
    answers: dict[str, int]
    """Number of answers by condition and tie."""
    by_answer: Proportion | None
    """Answers that chose the first condition; None if all are ties."""
    by_rater: Proportion | None
    """Raters who chose the first condition more often than the other; those who did neither more often are left out."""
    by_item: Proportion | None
    """Pictures of which the first condition's was chosen more often."""


@dataclass(frozen=True)
class Match:
    """How often a picture was matched with its own condition, on one question."""

    question: str
    chosen: dict[str, dict[str, int]]
    """Number of answers, by the condition of the reference and by the chosen one."""
    right: Proportion
    """Of all answers, against guessing; one-sided. Sides are drawn for each trial, so guesses are independent."""


@dataclass(frozen=True)
class Agreement:
    """How far the raters of a panel agree, on one question."""

    question: str
    raters: int
    pictures: int
    """Those that every rater rated."""
    alpha: float
    """Cronbach's alpha, the reliability of the raters' mean: ICC(3,k) of Shrout and Fleiss (1979)."""
    alpha_interval: tuple[float, float]
    """95 %, from the F distribution (Feldt 1965)."""
    one_rater: float
    """Reliability of a single rater, ICC(3,1)."""
    one_rater_interval: tuple[float, float]
    means: dict[str, float]
    """Mean rating by condition."""


@dataclass(frozen=True)
class Difference:
    """Mean rating of the first condition less that of another one, over items that both have."""

    question: str
    first: str
    other: str
    mean: float
    interval: tuple[float, float]
    """95 % by Student's distribution: over raters or over items, the wider one."""
    p_raters: float
    """Permutation test of the sign of each rater's mean difference."""
    p_items: float


def proportion(hits: int, of: int, chance: float = 0.5, *, greater: bool = False) -> Proportion | None:
    """Test a count against chance, two-sided unless `greater`; None where nothing was counted."""
    if of == 0:
        return None
    test = binomtest(hits, of, chance, alternative="greater" if greater else "two-sided")
    tail = (1 - _LEVEL) / 2
    low = float(beta.ppf(tail, hits, of - hits + 1)) if hits > 0 else 0.0
    high = float(beta.ppf(1 - tail, hits + 1, of - hits)) if hits < of else 1.0
    return Proportion(hits, of, hits / of, (low, high), float(test.pvalue))


def preferences(answers: Sequence[Answer], key: Key) -> list[Preference]:
    """Results of the form choice, by question and by other condition."""
    first, *others = key.conditions
    return [
        _preference(question, first, other, [a for a in answers if a.question == question and other in a.shown])
        for question in key.study.questions
        for other in others
    ]


def _preference(question: str, first: str, other: str, answers: Sequence[Answer]) -> Preference:
    counts = Counter(answer.value for answer in answers)

    def ahead(unit: Callable[[Answer], str]) -> Proportion | None:
        lead: Counter[str] = Counter()
        for answer in answers:
            lead[unit(answer)] += (answer.value == first) - (answer.value == other)
        return proportion(sum(each > 0 for each in lead.values()), sum(each != 0 for each in lead.values()))

    return Preference(
        question, first, other, dict(counts), proportion(counts[first], counts[first] + counts[other]),
        ahead(lambda answer: answer.rater), ahead(lambda answer: answer.item),
    )  # fmt: skip


def matches(answers: Sequence[Answer], key: Key) -> list[Match]:
    """Results of the form match, by question.

    Raises:
        ContractError: a question has no answer.
    """
    return [_match(question, _of(question, answers), key.conditions) for question in key.study.questions]


def _match(question: str, answers: Sequence[Answer], conditions: Sequence[str]) -> Match:
    counts = Counter((str(answer.right), answer.value) for answer in answers)
    chosen = {right: {value: counts[right, value] for value in conditions} for right in conditions}
    hits = sum(answer.right == answer.value for answer in answers)
    found = proportion(hits, len(answers), 1 / len(conditions), greater=True)
    assert found is not None
    return Match(question, chosen, found)


def agreements(answers: Sequence[Answer], key: Key) -> list[Agreement]:
    """How far the raters of a panel agree, by question.

    Raises:
        ContractError: fewer than two raters, or fewer than two pictures that all of them rated differently.
    """
    return [_agreement(question, _of(question, answers), key.conditions) for question in key.study.questions]


def _agreement(question: str, answers: Sequence[Answer], conditions: Sequence[str]) -> Agreement:
    raters = sorted({answer.rater for answer in answers})
    rated = {(answer.shown[0], answer.item, answer.rater): int(answer.value) for answer in answers}
    pictures = sorted({picture[:2] for picture in rated})
    complete = [picture for picture in pictures if all((*picture, rater) in rated for rater in raters)]
    if len(raters) < 2 or len(complete) < 2:
        raise ContractError(
            f"On {question!r}, {len(raters)} raters rated {len(complete)} pictures all; agreement needs two of each."
        )
    ratings = np.array([[rated[(*picture, rater)] for rater in raters] for picture in complete], dtype=float)
    alpha, alpha_interval, one, one_interval = reliability(ratings, question)
    means = {
        condition: float(np.mean([value for (name, _, _), value in rated.items() if name == condition]))
        for condition in conditions
    }
    return Agreement(question, len(raters), len(complete), alpha, alpha_interval, one, one_interval, means)


def reliability(
    ratings: NDArray[np.float64], what: str
) -> tuple[float, tuple[float, float], float, tuple[float, float]]:
    """ICC(3,k), its 95 % interval, ICC(3,1), and its 95 % interval, of ratings [pictures, raters].

    With F = the pictures' mean square over the residual's, ICC(3,k) = 1 - 1/F and ICC(3,1) = (F - 1)/(F + k - 1); both
    rise with F, whose interval follows from its distribution (Shrout and Fleiss 1979, Psychol. Bull. 86, 420-428).

    Raises:
        ContractError: every rater gave every picture the same, or differs from others by a constant.
    """
    pictures, raters = ratings.shape
    by_picture, by_rater = ratings.mean(1, keepdims=True), ratings.mean(0, keepdims=True)
    residual = ratings - by_picture - by_rater + ratings.mean()
    free = pictures - 1, (pictures - 1) * (raters - 1)
    between = raters * float(np.square(by_picture - ratings.mean()).sum()) / free[0]
    within = float(np.square(residual).sum()) / free[1]
    if between <= 1e-12 or within <= 1e-12:
        raise ContractError(f"On {what!r}, ratings do not vary between pictures or between raters; nothing to compare.")
    ratio = between / within
    tail = (1 + _LEVEL) / 2
    ratios = np.array([ratio, ratio / f.ppf(tail, *free), ratio / f.ppf(1 - tail, *free)])
    of_mean, of_one = 1 - 1 / ratios, (ratios - 1) / (ratios + raters - 1)
    (alpha, *alpha_bounds), (one, *one_bounds) = of_mean.tolist(), of_one.tolist()
    return alpha, (alpha_bounds[0], alpha_bounds[1]), one, (one_bounds[0], one_bounds[1])


def differences(answers: Sequence[Answer], key: Key, seed: int = 0) -> list[Difference]:
    """Results of a panel by question and other condition; none of items that only one condition has ratings of."""
    first, *others = key.conditions
    found = []
    for question in key.study.questions:
        rated = {(one.shown[0], one.item, one.rater): int(one.value) for one in _of(question, answers)}
        for other in others:
            pairs = [
                (item, rater, value - rated[other, item, rater])
                for (name, item, rater), value in rated.items()
                if name == first and (other, item, rater) in rated
            ]
            by_rater = _means((rater, value) for _, rater, value in pairs)
            by_item = _means((item, value) for item, _, value in pairs)
            if min(len(by_rater), len(by_item)) < 2:
                raise ContractError(
                    f"On {question!r}, {first} and {other} share {len(by_item)} items and {len(by_rater)} raters; "
                    "a comparison needs two of each."
                )
            mean = float(np.mean([value for _, _, value in pairs]))
            half = max(_half_width(by_rater), _half_width(by_item))
            found.append(
                Difference(
                    question, first, other, mean, (mean - half, mean + half), _sign_flips(by_rater, seed),
                    _sign_flips(by_item, seed),
                )
            )  # fmt: skip
    return found


def _of(question: str, answers: Iterable[Answer]) -> list[Answer]:
    found = [answer for answer in answers if answer.question == question]
    if not found:
        raise ContractError(f"Nobody answered {question!r}; give files with answers to it.")
    return found


def _means(pairs: Iterable[tuple[str, int]]) -> NDArray[np.float64]:
    """Mean of each unit's values."""
    values: dict[str, list[int]] = {}
    for unit, value in pairs:
        values.setdefault(unit, []).append(value)
    return np.array([np.mean(of_unit) for of_unit in values.values()])


def _half_width(values: NDArray[np.float64]) -> float:
    return float(t.ppf((1 + _LEVEL) / 2, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values)))


def _sign_flips(values: NDArray[np.float64], seed: int) -> float:
    test = permutation_test(
        (values,), lambda sample, axis: sample.mean(axis=axis), permutation_type="samples", n_resamples=_RESAMPLES,
        vectorized=True, rng=np.random.default_rng(seed),
    )  # fmt: skip
    return float(test.pvalue)
