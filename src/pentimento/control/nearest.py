"""The taught noun that is nearest in meaning to words that were never taught, by WordLlama's vectors (extra `voice`).

The vectors are averages over parts of words, so words that are only spelt alike are near too. The threshold is chosen
on the list in tests/control/test_nearest.py: most words of the list stay refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_ALIKE: Final = 0.64
"""Cosine similarity from which on a taught word stands for a phrase."""


@dataclass(frozen=True)
class Nearest:
    """A phrase, and the taught word that stands for it."""

    phrase: str
    word: str


def nearest_word(phrases: Sequence[str], words: Sequence[str]) -> Nearest | None:
    """The phrase and the taught word, in the singular, of which the meanings are nearest; None where none are alike.

    None also where the extra `voice` is not installed.
    """
    if find_spec("wordllama") is None:
        return None
    similarity = _embedded(tuple(phrases)) @ _embedded(tuple(words)).T  # [phrases, words]
    phrase, word = divmod(int(similarity.argmax()), len(words))
    return Nearest(phrases[phrase], words[word]) if similarity[phrase, word] >= _ALIKE else None


@cache
def _model() -> Any:
    import wordllama

    # The vectors of the wheel, beside the package's code; without this, they are looked for on the network.
    return wordllama.WordLlama.load(cache_dir=Path(wordllama.__file__).parent, disable_download=True)


@lru_cache(maxsize=16)
def _embedded(phrases: tuple[str, ...]) -> NDArray[np.float32]:
    """Unit vectors [phrases, 256]."""
    return np.asarray(_model().embed(list(phrases), norm=True), np.float32)
