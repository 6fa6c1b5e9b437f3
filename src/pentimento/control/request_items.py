"""A person's request as a sequence of items: things, counts, articles, relations, and words that are not known."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from pentimento.bundle.vocabulary import Vocabulary
from pentimento.contracts.errors import ConfigError

MANY: Final = 13
"""Stands for all larger numbers, which are too many to be drawn."""
MAX_LETTERS: Final = 200
"""Length of a request: four things with relations and adjectives have less."""

_INVISIBLE: Final = frozenset("\u034f\u115f\u1160\u17b4\u17b5\u2800\u3164\uffa0") | {
    chr(code) for code in range(0xFE00, 0xFE10)
}
"""Characters that show nothing, though Unicode counts them among letters, marks and symbols."""
_LONGEST: Final = 4
"""Words of the longest item: "to the left of"."""


@dataclass(frozen=True)
class Named:
    """A word for a taught noun."""

    said: str
    noun: str
    """The taught noun's name."""
    is_plural: bool
    is_taught: bool
    """The word itself was taught, as the noun or a synonym."""


@dataclass(frozen=True)
class Count:
    """A number of things."""

    said: str
    number: int
    is_pair: bool = False
    """Scissors and glasses are a pair of one."""


@dataclass(frozen=True)
class Article:
    """A word before a thing that says nothing about it: "a", "the", "my"."""

    said: str
    is_singular: bool


@dataclass(frozen=True)
class Link:
    """What stands between things: a relation, "and", or a comma."""

    said: str
    link: str
    """As the goal planner was taught it."""


@dataclass(frozen=True)
class Order:
    """An arrangement of all things: "in a row"."""

    said: str


@dataclass(frozen=True)
class Pronoun:
    """ "It": a thing that was named before."""

    said: str


@dataclass(frozen=True)
class Of:
    """ "Of", between a part or a group and the thing."""

    said: str = "of"


@dataclass(frozen=True)
class Other:
    """A word that is not known."""

    said: str


Item = Named | Count | Article | Link | Order | Pronoun | Of | Other

TAUGHT_LINKS: Final = (
    "and", ",", "with", "beside", "next to", "to the left of", "to the right of", "above", "over", "below", "under",
    "on", "on top of", "behind", "in front of", "before", "inside", "in", "between",
)  # fmt: skip
OTHER_LINKS: Final = {
    "&": "and", "+": "and", "plus": "and", "along with": "and", "together with": "and", "as well as": "and",
    "has": "with", "have": "with", "near": "beside", "by": "beside", "at": "beside", "alongside": "beside",
    "close to": "beside", "left of": "to the left of", "on the left of": "to the left of",
    "right of": "to the right of", "on the right of": "to the right of", "beneath": "below", "underneath": "under",
    "onto": "on", "upon": "on", "atop": "on top of", "in back of": "behind", "within": "inside", "inside of": "inside",
    "into": "in", "in between": "between",
}  # fmt: skip
_NUMBERS: Final = (
    "zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve",
)  # fmt: skip
_MANY: Final = (
    "thirteen", "fourteen", "fifteen", "sixteen", "seventeen", "eighteen", "nineteen", "twenty", "thirty", "forty",
    "fifty", "sixty", "seventy", "eighty", "ninety", "hundred", "hundreds", "thousand", "thousands", "million",
    "millions", "dozen", "dozens",
)  # fmt: skip
_ANY: Final = ("the", "some", "my", "your", "his", "her", "its", "our", "their", "these", "those", "all", "both")
_SINGLE: Final = ("a", "an", "another", "this", "each", "every")

_GRAMMAR: Final[Mapping[str, Item]] = {
    **{said: Link(said, said) for said in TAUGHT_LINKS},
    **{said: Link(said, link) for said, link in OTHER_LINKS.items()},
    **{said: Count(said, number) for number, said in enumerate(_NUMBERS)},
    **{said: Count(said, 2, is_pair=True) for said in ("a pair of", "pair of", "a couple of", "couple of")},
    **{said: Count(said, MANY) for said in _MANY},
    **{said: Article(said, False) for said in _ANY},
    **{said: Article(said, True) for said in _SINGLE},
    **{said: Order(said) for said in ("in a row", "side by side")},
    **{said: Pronoun(said) for said in ("it", "them", "him")},
    "of": Of(),
}
_SILENT: Final = frozenset({
    "are", "here's", "i'd", "is", "it's", "just", "kindly", "only", "please", "thank", "thanks", "that", "there",
    "there's", "was", "which", "who",
})  # fmt: skip
"""Words that say nothing of a picture: they are left out without a message."""
_OPENING: Final = re.compile(
    r"(?:(?:please|can|could|would|will|you|i|we|want|need|like|to|i'd|love|let's|us|me|draw|paint|sketch|make|create|show"
    r"|give|hello|hi|hey) |, )*"
    r"(?:(?:(?:an?|the) )?(?:\w+ )?(?:picture|drawing|painting|image|sketch|illustration|photo) of )?"
)
_CLOSING: Final = re.compile(r"(?:(?: ,)? (?:for (?:me|us)|thank you|in colou?rs?|with a marker))*$")
"""The setting of the bundle names the medium."""


def plain_text(words: str) -> str:
    """A person's words without surrounding space.

    Raises:
        ConfigError: there are none, there are too many, or some characters show nothing or control the terminal.
    """
    if len(words) > MAX_LETTERS:
        raise ConfigError(
            f"The request has {len(words)} characters; say in at most {MAX_LETTERS} what is to be drawn. "
            "Nothing was painted."
        )
    hidden = [letter for letter in words if unicodedata.category(letter)[0] == "C" or letter in _INVISIBLE]
    hidden += [letter for letter in words if unicodedata.category(letter) in ("Zl", "Zp")]
    if hidden:
        raise ConfigError(
            f"The request holds the control or invisible character U+{ord(hidden[0]):04X}; type it in plain letters. "
            "Nothing was painted."
        )
    if not words.strip():
        raise ConfigError('The request is empty; say what is to be drawn, such as "a cat". Nothing was painted.')
    return words.strip()


def nouns_by_word(vocabulary: Vocabulary) -> dict[str, Named]:
    """The words of a vocabulary, hyphens as spaces."""
    found: dict[str, Named] = {}
    for name, noun in vocabulary.nouns.items():
        forms = ((noun.words, False, True), (noun.plurals, True, True), (noun.nearest, False, False))
        for words, is_plural, is_taught in forms:
            for word in words:
                found.setdefault(_spaced(word), Named(word, name, is_plural, is_taught))
    return found


def scan(text: str, nouns: Mapping[str, Named]) -> list[Item]:
    """The items of a request, each as long as possible; `nouns` as from `nouns_by_word`."""
    tokens = _without_frame(_tokens(text), nouns)
    items: list[Item] = []
    at = 0
    while at < len(tokens):
        for length in range(min(_LONGEST, len(tokens) - at), 0, -1):
            said = " ".join(tokens[at : at + length])
            item = _GRAMMAR.get(said) or _named(said, nouns) or _number(said)
            if item is not None:
                items.append(item)
                break
        else:
            length = 1
            if tokens[at] not in _SILENT:
                items.append(Other(tokens[at]))
        at += length
    return items


def _tokens(text: str) -> list[str]:
    """Words in lower case without quotes and brackets; marks between sentences become commas."""
    text = unicodedata.normalize("NFKC", text).lower().replace("’", "'")
    text = re.sub(r"[,;.!?:/|\u2013\u2014]+", " , ", text)
    words = [word if word == "," else word.strip("'\"“”„«»()[]{}<>*_-`#") for word in text.split()]
    return " ".join(word for word in words if word).strip(" ,").split()


def _without_frame(tokens: Sequence[str], nouns: Mapping[str, Named]) -> list[str]:
    """What is wanted, without "please draw me a picture of" before it and "for me" after it."""
    text = " ".join(tokens) + " "
    opening = _OPENING.match(text)
    is_noun = any(_named(" ".join(tokens[:length]), nouns) for length in (2, 3))  # such as "love seat"
    if opening and opening.end() < len(text) and not is_noun:
        text = text[opening.end() :]
    closing = _CLOSING.search(text.rstrip())
    return (text[: closing.start()] if closing and closing.start() > 0 else text).split()


def _named(said: str, nouns: Mapping[str, Named]) -> Named | None:
    spaced = _spaced(said)
    found = nouns.get(spaced)
    if found is not None:
        return Named(said, found.noun, found.is_plural, found.is_taught)
    for singular in singulars(spaced):
        found = nouns.get(singular)
        if found is not None and not found.is_plural:
            return Named(said, found.noun, True, found.is_taught)
    return None


def singulars(word: str) -> Iterator[str]:
    """What a word may be the plural of."""
    for end, singular in (("ies", "y"), ("ves", "f"), ("ves", "fe"), ("es", ""), ("s", ""), ("men", "man")):
        if word.endswith(end) and len(word) > len(end) + 2:
            yield word.removesuffix(end) + singular


def _number(said: str) -> Count | None:
    return Count(said, min(int(said), MANY)) if re.fullmatch(r"[0-9]+", said) else None


def _spaced(word: str) -> str:
    return word.replace("-", " ")


def said_of(items: Sequence[Item]) -> str:
    """The words of items."""
    return " ".join(item.said for item in items)
