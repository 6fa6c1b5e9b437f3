"""A CLIP tokenizer learned from captions: byte-pair encoding in the published layout."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise

from tokenizers import pre_tokenizers
from transformers import CLIPTokenizer

START, END = "<|startoftext|>", "<|endoftext|>"
_WORD_END = "</w>"


def learn_tokenizer(captions: Sequence[str], merges: int, length: int) -> CLIPTokenizer:
    """A tokenizer with the most frequent byte-pair merges of `captions` (Sennrich et al. 2016).

    Any text in any language can be encoded, because all 256 bytes are tokens. The vocabulary is in the published order:
    bytes, bytes at the end of a word, merges, start, end.

    Args:
        merges: at most this many.
        length: of a caption in tokens, with start and end; longer ones are truncated.
    """
    os.environ.setdefault("TOKENIZERS_PARALLELISM", "false")
    alphabet = sorted(pre_tokenizers.ByteLevel.alphabet())
    symbols = [*alphabet, *(letter + _WORD_END for letter in alphabet)]
    found = _frequent_merges(captions, merges)
    words = list(dict.fromkeys([*symbols, *("".join(pair) for pair in found), START, END]))
    vocabulary = {word: index for index, word in enumerate(words)}
    return CLIPTokenizer(vocab=vocabulary, merges=found, model_max_length=length)


def _frequent_merges(captions: Sequence[str], merges: int) -> list[tuple[str, str]]:
    """Repeatedly merge the most frequent pair of adjacent symbols; of equally frequent pairs, the first in the
    alphabet.

    The trainer of `tokenizers` is not used, because its choice among equally frequent pairs changes from run to run.
    """
    blank = CLIPTokenizer().backend_tokenizer  # its way of cutting a caption into words
    counts = Counter(
        word
        for caption in captions
        for word, _ in blank.pre_tokenizer.pre_tokenize_str(blank.normalizer.normalize_str(caption))
    )
    words = {(*word[:-1], word[-1] + _WORD_END): count for word, count in sorted(counts.items())}
    found: list[tuple[str, str]] = []
    while len(found) < merges:
        pairs: Counter[tuple[str, str]] = Counter()
        for symbols, count in words.items():
            for pair in pairwise(symbols):
                pairs[pair] += count
        if not pairs:
            break
        best = min(pairs, key=lambda pair: (-pairs[pair], pair))
        found.append(best)
        words = {_joined(symbols, best): count for symbols, count in words.items()}
    return found


def _joined(symbols: tuple[str, ...], pair: tuple[str, str]) -> tuple[str, ...]:
    joined: list[str] = []
    for symbol in symbols:
        if joined and (joined[-1], symbol) == pair:
            joined[-1] += symbol
        else:
            joined.append(symbol)
    return tuple(joined)
