"""The wishes that a person may speak, as a bigram language model of the words that a goal planner was taught.

A bigram model is the grammar's regular approximation: after an article come nouns, after a noun a relation or the
end. Each class of words goes on with the classes that its row names, with that probability, uniformly over their words.
A word that no row allows does not follow.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from pentimento.bundle.vocabulary import Vocabulary
from pentimento.control.request_items import OTHER_LINKS, TAUGHT_LINKS

_VERBS: Final = ("draw", "paint", "sketch", "draw me", "paint me", "draw us", "paint us")
_OPENINGS: Final = (
    *_VERBS, *(f"please {verb}" for verb in _VERBS), *(f"can you {verb}" for verb in _VERBS), "i want", "i would like",
    *(f"{article} {what} of" for article in ("a", "the") for what in ("picture", "drawing", "painting")),
    *(f"draw {me}a {what} of" for me in ("", "me ") for what in ("picture", "drawing")),
)  # fmt: skip
_CLOSINGS: Final = ("please", "in a row", "side by side")
_ANY: Final = ("the", "my", "your", "some", "one", "another", "this")
_COUNTS: Final = ("two", "three", "four")
_NOT_SPOKEN: Final = frozenset({",", "&", "+"})
_IMPOSSIBLE: Final = -10.0
"""Logarithm to the base 10 of the probability of a word that the grammar does not allow."""


@dataclass(frozen=True)
class Grammar:
    """Classes of words or phrases, and the probability with which one class follows another."""

    members: Mapping[str, Sequence[str]]
    follows: Mapping[str, Mapping[str, float]]
    """By class, or "<s>" for the begin; "</s>" is the end."""


def wish_grammar(vocabulary: Vocabulary) -> Grammar:
    """The grammar of any number of things with relations, in the words of a vocabulary.

    The probabilities are chosen, not measured: half of the wishes are one thing, a fifth begin with an opening.
    """
    singular = dict.fromkeys(_spaced(word) for noun in vocabulary.nouns.values() for word in noun.words)
    plural = dict.fromkeys(_spaced(word) for noun in vocabulary.nouns.values() for word in noun.plurals)
    vowel = [word for word in singular if word[0] in "aeiou"]
    members = {
        "opening": _OPENINGS,
        "a": ("a",),
        "an": ("an",),
        "any": _ANY,
        "count": _COUNTS,
        "consonant": [word for word in singular if word[0] not in "aeiou"],
        "vowel": vowel,
        "plural": [word for word in plural if word not in singular],
        "link": [link for link in dict.fromkeys((*TAUGHT_LINKS, *OTHER_LINKS)) if link not in _NOT_SPOKEN],
        "closing": _CLOSINGS,
    }
    first = len(vowel) / len(singular)
    thing = {
        "a": 0.55 * (1 - first), "an": 0.55 * first, "any": 0.15, "count": 0.2, "plural": 0.06,
        "consonant": 0.04 * (1 - first), "vowel": 0.04 * first,
    }  # fmt: skip
    after = {"</s>": 0.5, "link": 0.45, "closing": 0.05}
    return Grammar(
        members,
        {
            "<s>": {"opening": 0.2, **{name: 0.8 * share for name, share in thing.items()}},
            "opening": thing, "link": thing, "a": {"consonant": 1.0}, "an": {"vowel": 1.0}, "count": {"plural": 1.0},
            "any": {"consonant": 0.8 * (1 - first), "vowel": 0.8 * first, "plural": 0.2},
            "consonant": after, "vowel": after, "plural": after, "closing": {"</s>": 1.0},
        },
    )  # fmt: skip


def arpa(grammar: Grammar, known: Mapping[str, object]) -> str:
    """The grammar over the words that are `known`, in ARPA's text form; a phrase is one token, see `token`."""
    members = {
        "<s>": ["<s>"], "</s>": ["</s>"],
        **{name: [token(word) for word in words if word in known] for name, words in grammar.members.items()},
    }  # fmt: skip
    unigrams = [f"{_IMPOSSIBLE:.4f} {word} {_IMPOSSIBLE:.4f}" for words in members.values() for word in words]
    bigrams = []
    for name, row in grammar.follows.items():
        possible = {then: share for then, share in row.items() if share > 0 and members[then]}
        whole = sum(possible.values())
        for then, share in possible.items():
            log10 = math.log10(share / whole / len(members[then]))
            bigrams += [f"{log10:.4f} {word} {next_one}" for word in members[name] for next_one in members[then]]
    return "\n".join([
        "\\data\\", f"ngram 1={len(unigrams)}", f"ngram 2={len(bigrams)}", "", "\\1-grams:", *unigrams, "",
        "\\2-grams:", *bigrams, "", "\\end\\", "",
    ])  # fmt: skip


def token(phrase: str) -> str:
    """A word or phrase as one token."""
    return phrase.replace(" ", "_")


def spoken(tokens: str) -> str:
    """The words of tokens."""
    return tokens.replace("_", " ")


def _spaced(word: str) -> str:
    return word.replace("-", " ")
