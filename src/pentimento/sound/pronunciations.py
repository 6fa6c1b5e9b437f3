"""How words are pronounced: by a dictionary, and by rules for plurals and compounds that it lacks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

Pronunciations = tuple[str, ...]
"""Ways to say a word, each as phones of the CMU dictionary: "K AE T"."""

_HISSING: Final = frozenset({"S", "Z", "SH", "ZH", "CH", "JH"})
_VOICELESS: Final = frozenset({"P", "T", "K", "F", "TH"})
_MIN_PART: Final = 3
"""Letters of the shortest part of a compound."""


def read_dictionary(path: Path) -> dict[str, Pronunciations]:
    """A dictionary in the format of CMU's: a word and its phones in each line, further ones as `word(2)`."""
    found: dict[str, list[str]] = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        word, _, phones = line.partition(" ")
        found.setdefault(word.partition("(")[0], []).append(phones.strip())
    return {word: tuple(each) for word, each in found.items()}


def pronounced(words: Iterable[str], dictionary: Mapping[str, Pronunciations]) -> dict[str, Pronunciations]:
    """The pronunciations of words or phrases; those with a word that neither dictionary nor rules know are missing."""
    found: dict[str, Pronunciations] = {}
    for phrase in words:
        parts = [_of_word(word, dictionary) for word in phrase.replace("-", " ").split()]
        if parts and all(parts):
            found[phrase] = parts[0] if len(parts) == 1 else (" ".join(part[0] for part in parts),)
    return found


def _of_word(word: str, dictionary: Mapping[str, Pronunciations]) -> Pronunciations:
    """Empty where nothing is known."""
    if word in dictionary:
        return dictionary[word]
    for end, singular in (("ies", "y"), ("es", ""), ("s", "")):
        known = dictionary.get(word.removesuffix(end) + singular, ()) if word.endswith(end) else ()
        if known:
            return tuple(f"{phones} {_plural_phones(phones)}" for phones in known)
    for at in range(len(word) - _MIN_PART, _MIN_PART - 1, -1):
        first, second = dictionary.get(word[:at]), dictionary.get(word[at:]) or _plural_of(word[at:], dictionary)
        if first and second:
            return (f"{first[0]} {second[0]}",)
    return ()


def _plural_of(word: str, dictionary: Mapping[str, Pronunciations]) -> Pronunciations:
    known = dictionary.get(word.removesuffix("s"), ()) if word.endswith("s") else ()
    return tuple(f"{phones} {_plural_phones(phones)}" for phones in known)


def _plural_phones(singular: str) -> str:
    """The phones that a plural adds: the s of cats, dogs or buses."""
    last = singular.split()[-1]
    return "IH Z" if last in _HISSING else "S" if last in _VOICELESS else "Z"
