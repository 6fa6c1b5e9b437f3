"""The words that a person may use for the things that the goal planner was taught, for a bundle."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from typing import Final

from pentimento.bundle.vocabulary import Noun, Vocabulary
from pentimento.contracts.scenes import phrase
from pentimento.copainting.drawings import sources
from pentimento.copainting.drawings.scenes import plural

_NEAREST_WORDS: Final = files("pentimento.copainting.drawings").joinpath("nearest_words.txt")
"""Lines such as `dog: beagle, poodle`: words that were not taught, by the noun as which they are drawn. The
lines before them, which begin with #, say where the words come from and under which licence.
"""


def taught_vocabulary() -> Vocabulary:
    """The nouns of `vocabulary.toml`, and the words of `nearest_words.txt` that stand for them."""
    lines = _NEAREST_WORDS.read_text(encoding="utf-8").splitlines()
    notice = "\n".join(line.removeprefix("#").strip() for line in lines if line.startswith("#"))
    pairs = (line.split(": ") for line in lines if not line.startswith("#"))
    nearest = {noun: tuple(words.split(", ")) for noun, words in pairs}
    return Vocabulary(notice, {name: _noun(noun, nearest) for name, noun in sources.vocabulary().items()})


def _noun(noun: sources.Noun, nearest: Mapping[str, tuple[str, ...]]) -> Noun:
    words = (noun.name, *noun.synonyms)
    plurals = tuple(form for form in dict.fromkeys(map(plural, words)) if form not in words)
    return Noun(phrase(noun.name), plural(noun.name), words, plurals, nearest.get(noun.name, ()))
