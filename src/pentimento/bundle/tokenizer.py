"""CLIP's byte-pair tokenizer in plain Python, from the published files (Radford et al. 2021; Sennrich et al. 2016).

The lean core encodes captions with it. Its ids equal those of ``transformers.CLIPTokenizer``: the same normalisation
(NFC, white space, lower case letter by letter), the same splitting into words, the same merges. The ``tokenizers``
library is not used here, because it requires an HTTP client and 30 MB of further packages.
"""

from __future__ import annotations

import json
import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError

START, END = "<|startoftext|>", "<|endoftext|>"

_WORD_END = "</w>"
_MARKS = (START, END)
_CONTRACTIONS = ("'s", "'t", "'re", "'ve", "'m", "'ll", "'d")
# Unicode's White_Space; Python's `\s` matches four more separators.
_SPACE = re.compile("[\t-\r \x85\xa0\u1680\u2000-\u200a\u2028\u2029\u202f\u205f\u3000]+")


@dataclass(frozen=True, eq=False)
class Tokenizer:
    """Vocabulary and merges of a CLIP text encoder."""

    vocabulary: Mapping[str, int]
    ranks: Mapping[tuple[str, str], int]
    """Rank of each merge; lower ranks are merged first."""
    length: int
    """Tokens of a caption with start and end; longer captions are truncated, shorter ones padded with ends."""

    def encode(self, captions: list[str]) -> NDArray[np.int64]:
        """Token ids [B, length] with start and end, padded with ends."""
        start, end = self.vocabulary[START], self.vocabulary[END]
        rows = np.full((len(captions), self.length), end, dtype=np.int64)
        for row, caption in zip(rows, captions, strict=True):
            tokens = [start, *self._tokens(caption)[: self.length - 2], end]
            row[: len(tokens)] = tokens
        return rows

    def _tokens(self, caption: str) -> list[int]:
        end, found = self.vocabulary[END], []
        for part in re.split("|".join(f"({re.escape(mark)})" for mark in _MARKS), caption):
            if part in _MARKS:
                found.append(self.vocabulary[part])
            elif part:
                for word in _words(_normalised(part)):
                    found += [self.vocabulary.get(symbol, end) for symbol in self._merged(word)]
        return found

    def _merged(self, word: str) -> list[str]:
        """The symbols of a word: its bytes, joined pair by pair in the order of the merges."""
        letters = [_BYTES[byte] for byte in word.encode()]
        symbols = [*letters[:-1], letters[-1] + _WORD_END]
        while len(symbols) > 1:
            rank, at = min((self.ranks.get(pair, len(self.ranks)), at) for at, pair in enumerate(pairwise(symbols)))
            if rank == len(self.ranks):
                break
            symbols[at : at + 2] = [symbols[at] + symbols[at + 1]]
        return symbols


def read_tokenizer(vocabulary: Path, merges: Path, length: int) -> Tokenizer:
    """A tokenizer from ``vocab.json`` and ``merges.txt`` as CLIP publishes them.

    Raises:
        ContractError: a file cannot be read, or has no start and end tokens.
    """
    try:
        words = json.loads(Path(vocabulary).read_text(encoding="utf-8"))
        lines = Path(merges).read_text(encoding="utf-8").split("\n")
    except (OSError, ValueError) as error:
        raise ContractError(f"The tokenizer {vocabulary}, {merges} cannot be read: {error}.") from error
    if not isinstance(words, dict) or not all(mark in words for mark in _MARKS):
        raise ContractError(f"The tokenizer {vocabulary} has no {START} and {END}; it is not a CLIP tokenizer.")
    if length < 2:
        raise ContractError(f"Captions of {length} tokens have no room for start and end; give 2 or more.")
    pairs = [tuple(line.split(" ")) for line in lines if line and not line.startswith("#version")]
    broken = [pair for pair in pairs if len(pair) != 2]
    if broken:
        raise ContractError(f"The tokenizer {merges} has a line of {len(broken[0])} words; each merge is a pair.")
    return Tokenizer(words, {(pair[0], pair[1]): rank for rank, pair in enumerate(pairs)}, length)


def _normalised(text: str) -> str:
    spaced = _SPACE.sub(" ", unicodedata.normalize("NFC", text))
    return "".join(letter.lower() for letter in spaced)  # letter by letter, so that a final sigma becomes a plain one


def _words(text: str) -> list[str]:
    """Words of a text: runs of letters, single digits, runs of other characters, and English contractions."""
    words, at = [], 0
    while at < len(text):
        known = next((word for word in (*_MARKS, *_CONTRACTIONS) if text.startswith(word, at)), None)
        end = at + 1
        if known is not None:
            end = at + len(known)
        elif (kind := _kind(text[at])) != "N":
            while end < len(text) and _kind(text[end]) == kind:
                end += 1
        if known in _MARKS:  # written in capitals: split like a special token
            words += [known[:2], known[2:-2], known[-2:]]
        elif known is not None or kind != " ":
            words.append(text[at:end])
        at = end
    return words


def _kind(letter: str) -> str:
    """L for letters, N for digits, a blank for white space, P for everything else."""
    if _SPACE.fullmatch(letter):
        return " "
    category = unicodedata.category(letter)[0]
    return category if category in "LN" else "P"


def _byte_letters() -> list[str]:
    """A visible character for each byte, as in GPT-2: a printable byte is itself, others map to 256 and up."""
    visible = [*range(ord("!"), ord("~") + 1), *range(ord("¡"), ord("¬") + 1), *range(ord("®"), ord("ÿ") + 1)]
    others = [byte for byte in range(256) if byte not in visible]
    letters = {byte: chr(byte) for byte in visible} | {byte: chr(256 + i) for i, byte in enumerate(others)}
    return [letters[byte] for byte in range(256)]


_BYTES = _byte_letters()
