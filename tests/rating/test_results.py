"""Results: what simulated raters do is found, and what they do not do is not."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom

from pentimento.contracts.errors import ContractError
from pentimento.rating.answers import Answer, read_answers
from pentimento.rating.page import Key
from pentimento.rating.results import agreements, differences, matches, preferences, reliability
from pentimento.rating.wording import result_lines
from tests.rating.raters import FIRST, OTHER, preferring, save, written

STUDIES = 500
ALPHA = 0.05


def test_raters_who_prefer_the_first_condition_are_found(tmp_path: Path) -> None:
    """The size of the thesis's survey: 24 raters, 4 of each of 40 pairs (section 6.6.1)."""
    _, key = written("text", 40, 24, per_rater=7)
    answers = read_answers(save(tmp_path, key, preferring(FIRST, 0.8, np.random.default_rng(0))), key)
    (found,) = preferences(answers, key)
    assert found.by_answer is not None and found.by_rater is not None and found.by_item is not None
    assert found.by_answer.of == 168 and abs(found.by_answer.share - 0.8) < 3 * np.sqrt(0.8 * 0.2 / 168)
    assert max(found.by_answer.p, found.by_rater.p, found.by_item.p) < 0.001
    assert f"{found.by_rater.hits} of {found.by_rater.of}" in "\n".join(result_lines(answers, key))


def test_coin_flips_are_significant_no_more_often_than_alpha() -> None:
    """Over many studies of 12 raters with an answer to each of 9 pictures: every sign test rejects as often as the
    binomial distribution says, which is no more than alpha.
    """
    _, key = written("text", 9, 12)
    flips = np.random.default_rng(1).random((STUDIES, 12, 9)) < 0.5
    rejected = {"by_answer": 0, "by_rater": 0, "by_item": 0}
    for study in flips:
        answers = [
            Answer(str(rater), str(item), "text", (FIRST, OTHER), None, FIRST if heads else OTHER, "")
            for rater, of_rater in enumerate(study)
            for item, heads in enumerate(of_rater)
        ]
        (found,) = preferences(answers, key)
        for unit in rejected:
            rejected[unit] += getattr(found, unit).p <= ALPHA
    for unit, units in {"by_answer": 108, "by_rater": 12}.items():
        expected = exact_rate(units)
        assert 0.03 < expected <= ALPHA
        assert abs(rejected[unit] / STUDIES - expected) < 4 * np.sqrt(expected / STUDIES)
    assert rejected["by_item"] / STUDIES < ALPHA + 4 * np.sqrt(
        ALPHA / STUDIES
    )  # pictures that raters tie on count less


def exact_rate(units: int) -> float:
    """How often a two-sided binomial test of fair coins has p of at most alpha."""
    tails = binom.cdf(np.arange(units + 1), units, 0.5)
    lowest = int(np.flatnonzero(2 * tails <= ALPHA)[-1])
    return float(2 * tails[lowest])


def test_sides_do_not_matter_to_who_always_chooses_the_left(tmp_path: Path) -> None:
    _, key = written("replication", 30, 20)
    (found,) = preferences(read_answers(save(tmp_path, key, lambda hidden: "1"), key), key)
    assert found.by_answer is not None and found.by_answer.of == 600
    assert abs(found.by_answer.share - 0.5) < 3 * 0.5 / np.sqrt(600)


def test_ties_decide_nothing(tmp_path: Path) -> None:
    _, key = written("text", 2, 2)
    (found,) = preferences(read_answers(save(tmp_path, key, lambda hidden: "both"), key), key)
    assert found.answers == {"both": 4} and found.by_answer is found.by_rater is found.by_item is None


def test_matches_are_counted_by_condition_and_tested_against_guessing(tmp_path: Path) -> None:
    styles = ("anna", "ben", "cleo", "dora", "emil")
    _, key = written("style", 4, 20, conditions=styles, per_rater=5)
    mistaken = {"anna": "dora"}
    answers = read_answers(
        save(
            tmp_path,
            key,
            lambda hidden: str(1 + hidden.shown.index(mistaken.get(str(hidden.right), str(hidden.right)))),
        ),
        key,
    )
    (found,) = matches(answers, key)
    assert found.chosen["anna"] == dict.fromkeys(styles, 0) | {"dora": 20} and found.chosen["ben"]["ben"] == 20
    assert (found.right.hits, found.right.of) == (80, 100)
    assert found.right.p == pytest.approx(binom.sf(79, 100, 0.2))
    rng = np.random.default_rng(0)
    (guessed,) = matches(read_answers(save(tmp_path, key, lambda hidden: str(rng.integers(1, 6))), key), key)
    assert guessed.right.p > ALPHA


def panel(key: Key, quality: dict[str, float], noise: float, rng: np.random.Generator) -> list[Answer]:
    """Ratings of raters who see the same quality, on a scale of 7, with their own leniency."""
    lenient = {page: rng.normal() for page in key.pages}
    return [
        Answer(
            page, hidden.item, question, hidden.shown, None,
            str(int(np.clip(np.rint(4 + quality[hidden.shown[0]] + item_effect(hidden.item) + lenient[page]
                                    + noise * rng.normal()), 1, 7))), "",
        )
        for page, parts in key.pages.items()
        for hidden in parts.values()
        for question in key.study.questions
    ]  # fmt: skip


def item_effect(item: str) -> float:
    return float(np.random.default_rng([int(item[-2:]), 5]).normal())


def test_a_panel_that_agrees_finds_the_better_condition() -> None:
    _, key = written("panel", 12, 8)
    answers = panel(key, {FIRST: 0.8, OTHER: -0.8}, 0.7, np.random.default_rng(0))
    agreed, compared = agreements(answers, key), differences(answers, key)
    assert all(one.alpha_interval[0] < one.alpha < one.alpha_interval[1] and one.alpha > 0.8 for one in agreed)
    assert all(one.one_rater < one.alpha and one.means[FIRST] > one.means[OTHER] for one in agreed)
    assert all(one.interval[0] > 0 and max(one.p_raters, one.p_items) < 0.01 for one in compared)


def test_reliability_is_that_of_a_published_table() -> None:
    """Six subjects and four judges of Shrout and Fleiss (1979), table 2: ICC(3,1) = .71, ICC(3,4) = .91."""
    ratings = np.array([[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]], float)
    alpha, _, one, _ = reliability(ratings, "table 2")
    assert alpha == pytest.approx(0.91, abs=0.005) and one == pytest.approx(0.71, abs=0.01)
    variances = ratings.var(axis=0, ddof=1).sum() / ratings.sum(axis=1).var(ddof=1)
    assert alpha == pytest.approx(4 / 3 * (1 - variances))  # Cronbach's own formula


def test_the_interval_of_reliability_covers_the_truth_as_often_as_it_says() -> None:
    rng, pictures, raters = np.random.default_rng(2), 15, 5
    truth = 1 / (1 + 1)  # variances of pictures and of residuals
    inside = 0
    for _ in range(2 * STUDIES):
        ratings = rng.normal(size=(pictures, 1)) + rng.normal(size=(1, raters)) + rng.normal(size=(pictures, raters))
        low, high = reliability(ratings, "simulated")[3]
        inside += low < truth < high
    assert abs(inside / (2 * STUDIES) - 0.95) < 4 * np.sqrt(0.95 * 0.05 / (2 * STUDIES))


def test_a_panel_without_a_difference_finds_one_no_more_often_than_alpha() -> None:
    _, key = written("panel", 8, 8)
    p = []
    for study in range(60):
        answers = [a for a in panel(key, {FIRST: 0, OTHER: 0}, 1.0, np.random.default_rng([study, 3]))]
        p += [each for one in differences(answers, key)[:1] for each in (one.p_raters, one.p_items)]
    assert sum(each <= ALPHA for each in p) <= binom.ppf(0.999, len(p), ALPHA)


def test_too_few_answers_are_refused_in_a_sentence(tmp_path: Path) -> None:
    _, key = written("panel", 3, 1)
    with pytest.raises(ContractError, match="1 raters rated"):
        agreements(panel(key, {FIRST: 0, OTHER: 0}, 1.0, np.random.default_rng(0)), key)
    with pytest.raises(ContractError, match="Nobody answered 'creativity'"):
        agreements([], key)
    constant = np.ones((4, 3))
    with pytest.raises(ContractError, match="do not vary"):
        reliability(constant, "liking")
