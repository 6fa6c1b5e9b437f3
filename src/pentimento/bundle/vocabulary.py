"""The nouns that a goal planner was taught, and the words that a person may use for them; a file of the bundle."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass

from pentimento.contracts.codec import from_plain
from pentimento.contracts.errors import ConfigError


@dataclass(frozen=True)
class Noun:
    """A taught noun."""

    one: str
    """One such thing, with the article that the noun takes: "a cat", "scissors"."""
    many: str
    """The plural: "cats"."""
    words: tuple[str, ...]
    """The noun and its taught synonyms, in the singular."""
    plurals: tuple[str, ...]
    """Their plurals, where they differ."""
    nearest: tuple[str, ...]
    """Words that were not taught, for kinds of it: "poodle" for a dog."""


@dataclass(frozen=True)
class Vocabulary:
    """Taught nouns by name. No word stands for two of them."""

    notice: str
    """Where the words come from, and under which licence."""
    by_window: bool
    """The goal planner was taught one thing at a time, which fills its picture; else whole scenes."""
    nouns: dict[str, Noun]

    def __post_init__(self) -> None:
        if not self.nouns:
            raise ValueError("it has no nouns")
        counts = Counter(word for noun in self.nouns.values() for word in (*noun.words, *noun.plurals, *noun.nearest))
        twice = [word for word, count in counts.items() if count > 1]
        if twice:
            raise ValueError(f"{twice[0]!r} stands there twice")


def read_vocabulary(data: bytes, where: str) -> Vocabulary:
    """The vocabulary in a file of the bundle; `where` names the file.

    Raises:
        ConfigError: the file holds something else.
    """
    try:
        plain = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise ConfigError(
            f"{where} is not plain JSON ({error}); write the bundle again with the stage deploy."
        ) from error
    return from_plain(Vocabulary, plain, where, ConfigError)
