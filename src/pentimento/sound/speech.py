"""The words of a spoken wish, by the embedded recogniser PocketSphinx (extra `voice`), whose models ship with it.

A search hears the recording as a wish in the taught words (`grammar`). It is accepted where the search is confident:
its words explain the sound well, and much better than other words do. Otherwise a search with a model of English hears
the recording once more (free text), under the same condition. Noise, other languages and mumbling end in a sentence.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np

from pentimento.bundle.vocabulary import Vocabulary
from pentimento.contracts.errors import ConfigError
from pentimento.control.request import Understood, understand
from pentimento.sound.grammar import arpa, spoken, token, wish_grammar
from pentimento.sound.pronunciations import Pronunciations, pronounced, read_dictionary
from pentimento.sound.recording import RATE_HZ, Recording, SoundError, check_level, dynamic_db

_MIN_CONFIDENCE: Final = -5.4
"""Of accepted words, see `Hypothesis`; docs/sound.md says how it was chosen."""
_PHONE_FRAMES: Final = (3.0, 25.0)
"""Mean duration of the phones of accepted words, in frames of 10 ms: a vowel of slow speech has 20. In a steady noise
a word lasts for seconds."""
_WEIGHT: Final = 1.5
"""Of the posterior probability in the confidence: about what a logistic regression gives it."""
_LEVEL: Final = 0.1
"""Root mean square of the loudest tenth of a second, to which a recording is scaled."""
_DITHER: Final = 2e-3
"""Standard deviation of added noise (-34 dB of the level): digital silence, as in synthetic speech, has no features."""
_MARGIN_S: Final = 0.3
"""Such noise before and after the recording, where the search begins and ends."""
_MIN_DYNAMIC_DB: Final = 7.0
"""Of a recording with speech, see `dynamic_db`: speech at 15 dB over the noise has 15, steady noises at most 5."""
_SETTINGS: Final[dict[str, Any]] = {"samprate": RATE_HZ, "loglevel": "FATAL"}


@dataclass(frozen=True)
class Hypothesis:
    """What a search finds."""

    words: str
    confidence: float
    """Weighted sum of two logarithms: the words' acoustic score per frame of 10 ms, relative to the best state of the
    model in that frame, and their posterior probability per word among all words that the search considered."""
    phone_frames: float
    """Mean duration of a phone, in frames of 10 ms."""


_NOTHING: Final = Hypothesis("", -math.inf, 0.0)


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
        self._wishes = None if vocabulary is None else self._search_for_wishes(vocabulary)

    def words_of(self, recording: Recording) -> str:
        """The words of a spoken wish.

        Raises:
            SoundError: the recording is silent or nothing but noise, or holds nothing that is understood.
        """
        check_level(recording)
        if dynamic_db(recording) < _MIN_DYNAMIC_DB:
            raise SoundError(
                "In the recording no speech stands out from the noise; come nearer to the microphone, and say the wish "
                "again. Nothing was painted."
            )
        wish = self.wish(recording)
        words = self.accepted(wish, lambda: self.free_text(recording))
        if words is not None:
            return words
        raise SoundError(
            f"No wish is understood in the recording{f' (it may be “{wish.words}”)' if wish.words else ''}; say in "
            "English what is to be drawn, such as “a cat beside a tree”, near the microphone. Nothing was painted."
        )

    def accepted(self, wish: Hypothesis, free_text: Callable[[], Hypothesis]) -> str | None:
        """The words of the hypothesis that is accepted; None where neither is. Free text is heard only if needed."""
        if _is_sure(wish) and self._understood(wish) is not None:
            return wish.words
        free = free_text()
        if _is_sure(free) and (request := self._understood(free)) is not None and not request.left_out:
            return free.words
        return None

    def wish(self, recording: Recording) -> Hypothesis:
        """The likeliest wish in the taught words, however unlikely. Raises SoundError where the recording is silent."""
        return _NOTHING if self._wishes is None else _found(self._wishes, _pcm(recording))

    def free_text(self, recording: Recording) -> Hypothesis:
        """The likeliest English words. Raises SoundError where the recording is silent."""
        return _found(self._english, _pcm(recording))

    @cached_property
    def _english(self) -> Any:
        return self._library.Decoder(self._library.Config(**_SETTINGS))

    def _search_for_wishes(self, vocabulary: Vocabulary) -> Any:
        dictionary = read_dictionary(Path(self._library.get_model_path("en-us/cmudict-en-us.dict")))
        grammar = wish_grammar(vocabulary)
        known = pronounced((word for words in grammar.members.values() for word in words), dictionary)
        with tempfile.TemporaryDirectory() as folder:
            words, model = Path(folder) / "words.dict", Path(folder) / "words.arpa"
            words.write_text("".join(_entries(known)), encoding="utf-8")
            model.write_text(arpa(grammar, known), encoding="utf-8")
            return self._library.Decoder(self._library.Config(dict=str(words), lm=str(model), **_SETTINGS))

    def _understood(self, found: Hypothesis) -> Understood | None:
        try:
            return understand(found.words, self._vocabulary, near=False)
        except ConfigError:
            return None


def _is_sure(found: Hypothesis) -> bool:
    min_frames, max_frames = _PHONE_FRAMES
    return found.confidence >= _MIN_CONFIDENCE and min_frames <= found.phone_frames <= max_frames


def _entries(words: Mapping[str, Pronunciations]) -> list[str]:
    """Lines of a dictionary."""
    return [
        f"{token(word)}{f'({number})' if number > 1 else ''} {phones}\n"
        for word, ways in words.items()
        for number, phones in enumerate(ways, 1)
    ]


def _pcm(recording: Recording) -> bytes:
    """The recording at a usual level with a little noise, as 16-bit samples.

    Raises:
        SoundError: it is silent.
    """
    samples = recording.samples.astype(np.float64) - recording.samples.mean()
    levels = np.pad(samples * (_LEVEL / check_level(recording)), round(_MARGIN_S * RATE_HZ))
    levels += np.random.default_rng(0).normal(0.0, _DITHER, len(levels))
    return (np.clip(levels, -1.0, 1.0) * 32767).astype("<i2").tobytes()


def _found(search: Any, data: bytes) -> Hypothesis:
    search.start_utt()
    search.process_raw(data, full_utt=True)
    search.end_utt()
    best = search.hyp()
    # Neither silence nor noises, which are written as <sil> or [NOISE].
    parts = [] if best is None else [part for part in search.seg() if part.word[0] not in "<[+"]
    if not parts:
        return _NOTHING
    frames = sum(part.end_frame - part.start_frame + 1 for part in parts)
    score = sum(math.log(part.ascore) for part in parts) / frames
    posterior = math.log(max(best.prob, 1e-300)) / len(parts)
    # A further pronunciation of a word is written as word(2).
    words = " ".join(spoken(part.word.partition("(")[0]) for part in parts)
    phones = sum(len(search.lookup_word(part.word).split()) for part in parts)
    return Hypothesis(words, score + _WEIGHT * posterior, frames / phones)
