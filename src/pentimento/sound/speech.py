"""The words of a spoken wish, by the embedded recogniser PocketSphinx (extra `voice`), whose models ship with it.

Two searches hear the recording: one for wishes in the taught words (`grammar`), one for any sequence of phones. Where
the words explain the sound almost as well as free phones do, they are accepted; noise and other languages are explained
much worse. Where they do not, a search with a language model of English hears it once more (free text), under the same
condition.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np

from pentimento.bundle.vocabulary import Vocabulary
from pentimento.contracts.errors import ConfigError
from pentimento.control.request import understand
from pentimento.sound.grammar import arpa, spoken, token, wish_grammar
from pentimento.sound.pronunciations import Pronunciations, pronounced, read_dictionary
from pentimento.sound.recording import RATE_HZ, Recording, SoundError, check_level

_PHONES: Final = (
    "AA", "AE", "AH", "AO", "AW", "AY", "B", "CH", "D", "DH", "EH", "ER", "EY", "F", "G", "HH", "IH", "IY", "JH", "K",
    "L", "M", "N", "NG", "OW", "OY", "P", "R", "S", "SH", "T", "TH", "UH", "UW", "V", "W", "Y", "Z", "ZH",
)  # fmt: skip
_LEVEL: Final = 0.1
"""Root mean square of the loudest tenth of a second, to which a recording is scaled."""
_DITHER: Final = 2e-3
"""Standard deviation of added noise (-34 dB of the level): digital silence, as in synthetic speech, has no features."""
_MARGIN_S: Final = 0.3
"""Such noise before and after the recording, where the search begins and ends."""
_MIN_RATIO: Final = -0.6
"""Acoustic score of accepted words less that of free phones, per frame of 10 ms; see docs/sound.md for the choice."""
_FEATURES: Final[dict[str, Any]] = {"samprate": RATE_HZ, "loglevel": "FATAL"}
"""Of all searches."""


@dataclass(frozen=True)
class _Segment:
    """A word or phone in a recording, without silence."""

    word: str
    first: int
    """Frame of 10 ms."""
    last: int
    score: float
    """Natural logarithm of its acoustic score."""


class Recogniser:
    """Searches for the wishes that a vocabulary allows; they are loaded once."""

    def __init__(self, vocabulary: Vocabulary | None) -> None:
        """Without a vocabulary (a goal planner that knows all words), only free text is heard.

        Raises:
            ConfigError: the extra `voice` is not installed.
        """
        try:
            import pocketsphinx
        except ImportError as error:
            raise ConfigError(
                "To listen, the recogniser PocketSphinx has to be installed: pip install 'pentimento[voice]'."
            ) from error
        self._library, self._vocabulary = pocketsphinx, vocabulary
        self._phones = self._decoder(*_phone_loop(), lw=1.0)
        self._taught = None if vocabulary is None else self._decoder(*self._taught_words(vocabulary))

    def words_of(self, recording: Recording) -> str:
        """The words of a spoken wish.

        Raises:
            SoundError: the recording is silent, or holds nothing that is understood.
        """
        data = _pcm(recording)
        phones = _segments(self._phones, data)
        taught = [] if self._taught is None else _segments(self._taught, data)
        words = spoken(" ".join(segment.word for segment in taught))
        if _ratio(taught, phones) >= _MIN_RATIO and self._is_understood(words):
            return words
        free = _segments(self._english, data)
        words = _text(free)
        if _ratio(free, phones) >= _MIN_RATIO and self._is_understood(words):
            return words
        raise SoundError(
            f"No wish is understood in the recording{f' (it sounds like “{words}”)' if words else ''}; say in English "
            "what is to be drawn, such as “a cat beside a tree”, near the microphone. Nothing was painted."
        )

    def free_text(self, recording: Recording) -> str:
        """What the model of English alone hears, whatever it is. Raises SoundError where the recording is silent."""
        return _text(_segments(self._english, _pcm(recording)))

    @cached_property
    def _english(self) -> Any:
        return self._library.Decoder(self._library.Config(**_FEATURES))

    def _is_understood(self, words: str) -> bool:
        if not words:
            return False
        try:
            understand(words, self._vocabulary)
        except ConfigError:
            return False
        return True

    def _taught_words(self, vocabulary: Vocabulary) -> tuple[Mapping[str, Pronunciations], str]:
        dictionary = read_dictionary(Path(self._library.get_model_path("en-us/cmudict-en-us.dict")))
        grammar = wish_grammar(vocabulary)
        known = pronounced((word for words in grammar.members.values() for word in words), dictionary)
        return known, arpa(grammar, known)

    def _decoder(self, words: Mapping[str, Pronunciations], model: str, **settings: Any) -> Any:
        """A search for words by their pronunciations and a language model in ARPA's form."""
        with tempfile.TemporaryDirectory() as folder:
            dictionary, grammar = Path(folder) / "words.dict", Path(folder) / "words.arpa"
            dictionary.write_text("".join(_entries(words)), encoding="utf-8")
            grammar.write_text(model, encoding="utf-8")
            config = self._library.Config(dict=str(dictionary), lm=str(grammar), **_FEATURES, **settings)
            return self._library.Decoder(config)


def _text(segments: list[_Segment]) -> str:
    """Words without the marks of noises, such as "[NOISE]", and of pronunciations, such as "a(2)"."""
    return " ".join(segment.word.partition("(")[0] for segment in segments if segment.word[0] not in "<[+")


def _entries(words: Mapping[str, Pronunciations]) -> list[str]:
    """Lines of a dictionary."""
    return [
        f"{token(word)}{f'({number})' if number > 1 else ''} {phones}\n"
        for word, ways in words.items()
        for number, phones in enumerate(ways, 1)
    ]


def _phone_loop() -> tuple[Mapping[str, Pronunciations], str]:
    """Any phone follows any, equally likely."""
    share = f"{-math.log10(len(_PHONES) + 1):.4f}"
    lines = ["\\data\\", f"ngram 1={len(_PHONES) + 2}", "", "\\1-grams:", "-99 <s>", f"{share} </s>"]
    lines += [*(f"{share} {phone}" for phone in _PHONES), "", "\\end\\", ""]
    return {phone: (phone,) for phone in _PHONES}, "\n".join(lines)


def _pcm(recording: Recording) -> bytes:
    """The recording at a usual level with a little noise, as 16-bit samples.

    Raises:
        SoundError: it is silent.
    """
    samples = recording.samples.astype(np.float64) - recording.samples.mean()
    levels = np.pad(samples * (_LEVEL / check_level(recording)), round(_MARGIN_S * RATE_HZ))
    levels += np.random.default_rng(0).normal(0.0, _DITHER, len(levels))
    levels = np.clip(levels, -1.0, 1.0)
    return (levels * 32767).astype("<i2").tobytes()


def _segments(decoder: Any, data: bytes) -> list[_Segment]:
    """What a search finds, without silence; nothing where it finds nothing."""
    decoder.start_utt()
    decoder.process_raw(data, full_utt=True)
    decoder.end_utt()
    if decoder.hyp() is None:
        return []
    return [
        _Segment(each.word, each.start_frame, each.end_frame, math.log(each.ascore))
        for each in decoder.seg()
        if each.word not in ("<s>", "</s>", "<sil>")
    ]


def _ratio(words: list[_Segment], phones: list[_Segment]) -> float:
    """Logarithm of the likelihood ratio of words to free phones, per frame of the words; -inf without words."""
    if not words:
        return -math.inf
    first, last = words[0].first, words[-1].last
    free = 0.0
    for phone in phones:
        shared = min(last, phone.last) - max(first, phone.first) + 1
        free += phone.score * max(0, shared) / (phone.last - phone.first + 1)
    return (sum(word.score for word in words) - free) / (last - first + 1)
