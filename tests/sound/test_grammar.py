"""The grammar of wishes is a bigram model: its probabilities sum to 1, and it says only what can be understood."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from pentimento.bundle.vocabulary import Vocabulary
from pentimento.contracts.errors import ConfigError
from pentimento.control.request import understand
from pentimento.deploy.words import taught_vocabulary
from pentimento.sound.grammar import arpa, spoken, token, wish_grammar
from tests.control.painting_bundle import small_vocabulary


@cache
def taught() -> Vocabulary:
    return taught_vocabulary("named")


def bigrams(vocabulary: Vocabulary) -> dict[str, dict[str, float]]:
    """Probabilities by the word before and the word."""
    grammar = wish_grammar(vocabulary)
    lines = arpa(grammar, {word: () for words in grammar.members.values() for word in words}).splitlines()
    found: dict[str, dict[str, float]] = {}
    for line in lines[lines.index("\\2-grams:") + 1 :]:
        parts = line.split()
        if len(parts) == 3:
            found.setdefault(parts[1], {})[parts[2]] = 10 ** float(parts[0])
    return found


@pytest.mark.parametrize("vocabulary", [taught(), small_vocabulary()], ids=["taught", "small"])
def test_what_follows_a_word_has_probability_one(vocabulary: Vocabulary) -> None:
    for word, row in bigrams(vocabulary).items():
        assert abs(sum(row.values()) - 1) < 0.01, word  # of four decimals


def test_every_word_belongs_to_one_class() -> None:
    members = [token(word) for words in wish_grammar(taught()).members.values() for word in words]
    assert len(members) == len(set(members))


def test_counts_in_the_header_are_those_of_the_lines() -> None:
    grammar = wish_grammar(small_vocabulary())
    lines = arpa(grammar, {"a": (), "cat": (), "dogs": (), "two": ()}).splitlines()
    one, two, end = (lines.index(line) for line in ("\\1-grams:", "\\2-grams:", "\\end\\"))
    assert f"ngram 1={two - one - 2}" in lines and f"ngram 2={end - two - 2}" in lines
    assert not any("dog" in line.split() for line in lines)  # it is not known how it is said


def test_what_the_grammar_says_is_understood() -> None:
    """Wishes that are drawn from it are refused for too many things alone."""
    rows, rng = bigrams(taught()), np.random.default_rng(1)
    refusals = 0
    for _ in range(300):
        words = ["<s>"]
        while words[-1] != "</s>":
            names = list(rows[words[-1]])
            shares = np.array([rows[words[-1]][name] for name in names])
            words.append(names[rng.choice(len(names), p=shares / shares.sum())])
        wish = spoken(" ".join(words[1:-1]))
        try:
            understand(wish, taught(), near=False)
        except ConfigError as error:
            refusals += 1
            assert "more than four things" in str(error), (wish, error)
    assert refusals < 60
