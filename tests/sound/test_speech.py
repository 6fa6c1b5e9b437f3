"""Spoken wishes are recognised; silence, noise and other languages end in a sentence."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.errors import ConfigError
from pentimento.control.request import understand
from pentimento.deploy.words import taught_vocabulary
from pentimento.sound.recording import RATE_HZ, Recording, SoundError, read_recording, recording_of
from pentimento.sound.speech import Recogniser
from tests.sound.spoken import ESPEAK, speak, tone, wav

pytest.importorskip("pocketsphinx", reason="needs the extra voice")
needs_speech = pytest.mark.skipif(ESPEAK is None, reason="needs espeak-ng")


@cache
def recogniser() -> Recogniser:
    return Recogniser(taught_vocabulary("named"))


@needs_speech
@pytest.mark.parametrize(
    "words", ["a dog beside a tree", "two birds above a house", "draw me a bicycle", "three birds above a tree"]
)
def test_a_spoken_wish_is_recognised(words: str, tmp_path: Path) -> None:
    recording = read_recording(speak(words, tmp_path / "wish.wav"))
    assert recogniser().words_of(recording) == words
    understand(words, taught_vocabulary("named"))


@needs_speech
def test_the_kind_of_file_changes_nothing(tmp_path: Path) -> None:
    """8 bits, stereo at 48 kHz, quiet and with an offset: the words stay."""
    plain = read_recording(speak("a dog beside a tree", tmp_path / "wish.wav")).samples
    times = np.arange(3 * len(plain)) / 3
    fast = np.interp(times, np.arange(len(plain)), plain)  # 48 kHz
    loud = plain / np.abs(plain).max()
    for content in (
        wav((128 + 120 * loud).astype(np.uint8), RATE_HZ),
        wav(np.stack([fast, fast], axis=1).astype(np.float32), 48_000),
        wav((0.1 * plain + 0.2).astype(np.float32), RATE_HZ),
    ):
        assert recogniser().words_of(recording_of(content, "It")) == "a dog beside a tree"


@needs_speech
def test_the_same_recording_gives_the_same_words(tmp_path: Path) -> None:
    first, other = (
        read_recording(speak(words, tmp_path / "wish.wav")) for words in ("two birds above a house", "a bus")
    )
    before = recogniser().wish(first)
    recogniser().wish(other)
    after = recogniser().wish(first)
    assert after.words == before.words and after.confidence == pytest.approx(before.confidence, abs=0.5)


@needs_speech
@pytest.mark.parametrize(
    ("words", "voice"), [("ein Hund unter einem Tisch", "de"), ("une maison rouge", "fr"), ("un gato y un perro", "es")]
)
def test_another_language_is_refused_with_one_sentence(words: str, voice: str, tmp_path: Path) -> None:
    with pytest.raises(SoundError, match="No wish is understood") as error:
        recogniser().words_of(read_recording(speak(words, tmp_path / "wish.wav", voice)))
    assert "Nothing was painted." in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("kind", ["white", "hum", "tone", "clicks"])
def test_noise_is_refused(kind: str) -> None:
    rng, count = np.random.default_rng(3), 2 * RATE_HZ
    samples = {
        "white": 0.05 * rng.normal(size=count),
        "hum": tone(2.0, RATE_HZ, 0.3, 50.0) + 0.001 * rng.normal(size=count),
        "tone": tone(2.0, RATE_HZ, 0.3, 300.0) + 0.001 * rng.normal(size=count),
        "clicks": np.where(rng.random(count) < 1e-3, 0.5, 0.0),
    }[kind]
    with pytest.raises(SoundError, match="Nothing was painted"):
        recogniser().words_of(Recording(samples.astype(np.float32)))


def test_silence_is_refused() -> None:
    for level in (0.0, 1e-4):
        with pytest.raises(SoundError, match="silent"):
            recogniser().words_of(Recording(np.random.default_rng(0).normal(0, level, RATE_HZ).astype(np.float32)))


@needs_speech
def test_without_a_vocabulary_free_text_alone_is_heard(tmp_path: Path) -> None:
    recording = read_recording(speak("an elephant", tmp_path / "wish.wav"))
    assert Recogniser(None).wish(recording).words == "" and Recogniser(None).free_text(recording).words


def test_without_the_package_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pocketsphinx", None)
    with pytest.raises(ConfigError, match=r"pentimento\[voice\]"):
        Recogniser(None)
