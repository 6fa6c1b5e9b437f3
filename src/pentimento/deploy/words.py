"""The words that a person may use for the things that the goal planner was taught, for a bundle."""

from __future__ import annotations

from importlib.resources import files
from typing import Final, Literal

from pentimento.bundle.vocabulary import Noun, Vocabulary
from pentimento.contracts.scenes import phrase
from pentimento.copainting.drawings import sources
from pentimento.copainting.drawings.scenes import plural
from pentimento.copainting.scenes.things import KINDS

_NEAREST_WORDS: Final = files("pentimento.copainting.drawings").joinpath("nearest_words.txt")
"""Lines such as `dog: beagle, poodle`: words that were not taught, by the noun as which they are drawn. The
lines before them, which begin with #, say where the words come from and under which licence.
"""


Things = Literal["named", "synthetic"]
"""What a goal planner was taught: the nouns of `vocabulary.toml`, or the kinds of `copainting.scenes.things`."""


def taught_vocabulary(things: Things) -> Vocabulary:
    """The taught nouns, and the words of `vocabulary.toml` and `nearest_words.txt` that stand for them."""
    lines = _NEAREST_WORDS.read_text(encoding="utf-8").splitlines()
    notice = "\n".join(line.removeprefix("#").strip() for line in lines if line.startswith("#"))
    pairs = (line.split(": ") for line in lines if not line.startswith("#"))
    nearest = {noun: tuple(words.split(", ")) for noun, words in pairs}
    if things == "named":
        taught = {name: (name, *noun.synonyms) for name, noun in sources.vocabulary().items()}
    else:  # synonyms were not taught
        taught = {kind: (kind,) for kind in KINDS}
        nearest = {name: (*noun.synonyms, *nearest.get(name, ())) for name, noun in sources.vocabulary().items()}
    known = {word for words in taught.values() for word in words}
    return Vocabulary(
        notice,
        things == "named",
        {
            name: _noun(words, tuple(word for word in nearest.get(name, ()) if word not in known))
            for name, words in taught.items()
        },
    )


def _noun(words: tuple[str, ...], nearest: tuple[str, ...]) -> Noun:
    plurals = tuple(form for form in dict.fromkeys(map(plural, words)) if form not in words)
    return Noun(phrase(words[0]), plural(words[0]), words, plurals, nearest)
