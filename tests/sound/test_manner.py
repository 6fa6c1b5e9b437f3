"""Loudness, pitch and pace of sounds whose pitch and pace are known."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pentimento.sound.manner import is_speech, manner_of, pitches_hz, speaking_s, speech_levels, syllables
from pentimento.sound.recording import RATE_HZ, Recording, read_recording
from tests.sound.spoken import ESPEAK, speak, tone

Samples = NDArray[np.float32]


def pulses(hertz: float | NDArray[np.float64]) -> Samples:
    """A second of a pulse train, or one of varying frequency, through a damped resonance at 700 Hz, as a glottis sounds
    through a vowel."""
    hertz = np.full(RATE_HZ, hertz) if isinstance(hertz, float) else hertz
    count = len(hertz)
    train = np.diff(np.floor(np.cumsum(hertz) / RATE_HZ), prepend=-1.0)
    decay_s = np.arange(round(0.02 * RATE_HZ)) / RATE_HZ
    response = np.exp(-300 * decay_s) * np.sin(2 * np.pi * 700 * decay_s)
    sound = np.convolve(train, response)[:count]
    return (0.4 * sound / np.abs(sound).max()).astype(np.float32)


def in_room(samples: Samples, level: float = 1e-3, pause_s: float = 0.5) -> Recording:
    """The samples between two pauses, with white noise throughout."""
    padded = np.pad(samples, round(pause_s * RATE_HZ))
    return Recording((padded + level * np.random.default_rng(1).normal(size=len(padded))).astype(np.float32))


@pytest.mark.parametrize("hertz", [80.0, 110.0, 220.0, 330.0, 450.0])
def test_pitch_is_that_of_the_sound(hertz: float) -> None:
    sine = pitches_hz(Recording(tone(1.0, RATE_HZ, 0.4, hertz)))
    assert sine == pytest.approx(hertz, rel=0.01)
    found = manner_of(in_room(pulses(hertz)), "ah")
    assert found.pitch_hz == pytest.approx(hertz, rel=0.01)
    assert found.pitch_range_st < 0.3


def test_range_of_a_glide_is_eight_tenths_of_its_ends_interval() -> None:
    found = manner_of(in_room(pulses(120 * 2 ** np.linspace(0.0, 1.0, 2 * RATE_HZ))), "ah")
    assert found.pitch_range_st == pytest.approx(0.8 * 12, abs=0.3)
    assert found.pitch_hz == pytest.approx(120 * math.sqrt(2), rel=0.02)


def test_a_few_frames_an_octave_apart_are_no_range() -> None:
    steady, creak = np.full(RATE_HZ, 160.0), np.full(RATE_HZ // 6, 80.0)
    found = manner_of(in_room(pulses(np.concatenate([steady, creak]))), "ah")
    assert found.pitch_range_st < 0.3 and found.pitch_hz == pytest.approx(160.0, rel=0.01)


def test_range_is_the_same_an_octave_higher() -> None:
    rising = 2 ** np.linspace(0.0, 0.5, RATE_HZ)
    low, high = (manner_of(in_room(pulses(base * rising)), "ah") for base in (110.0, 220.0))
    assert high.pitch_range_st == pytest.approx(low.pitch_range_st, abs=0.2)
    assert high.pitch_hz == pytest.approx(2 * low.pitch_hz, rel=0.01)


def test_noise_and_silence_have_no_pitch() -> None:
    noise = np.random.default_rng(0).normal(0, 0.1, RATE_HZ).astype(np.float32)
    assert np.isnan(pitches_hz(Recording(noise))).mean() > 0.95
    assert np.isnan(pitches_hz(Recording(np.zeros(RATE_HZ, np.float32)))).all()
    assert len(pitches_hz(Recording(np.zeros(10, np.float32)))) == 0


def test_nothing_changes_with_the_microphones_level() -> None:
    recording = in_room(pulses(150.0))
    one, other = manner_of(recording, "ah"), manner_of(Recording(recording.samples / 4), "ah")
    assert (one.loudness_db, one.pitch_hz, one.pitch_range_st, one.pace_hz) == pytest.approx(
        (other.loudness_db, other.pitch_hz, other.pitch_range_st, other.pace_hz), rel=1e-6
    )


def test_loudness_rises_by_the_decibels_of_the_voice() -> None:
    soft, loud = (manner_of(in_room(factor * pulses(150.0)), "ah").loudness_db for factor in (0.1, 1.0))
    assert loud - soft == pytest.approx(20.0, abs=0.3)


def test_levels_are_the_power_in_the_band() -> None:
    levels = speech_levels(Recording(tone(1.0, RATE_HZ, 0.5, 1000.0)))
    assert levels == pytest.approx(0.125, rel=0.01)
    outside = speech_levels(Recording(tone(1.0, RATE_HZ, 0.5, 50.0)))
    assert outside.max() < 1e-3 * 0.125


def test_pace_is_syllables_over_speech_without_its_pauses() -> None:
    beat = tone(0.3, RATE_HZ, 0.4, 500.0)
    short, long = np.zeros(round(0.1 * RATE_HZ), np.float32), np.zeros(round(1.0 * RATE_HZ), np.float32)
    recording = in_room(np.concatenate([beat, short, beat, long, beat]))
    assert speaking_s(is_speech(speech_levels(recording))) == pytest.approx(1.0, abs=0.08)
    assert manner_of(recording, "a cat, a dog").pace_hz == pytest.approx(4.0, rel=0.08)


def test_what_cannot_be_measured_is_nan() -> None:
    steady = manner_of(Recording(0.1 * np.random.default_rng(0).normal(size=RATE_HZ).astype(np.float32)), "a cat")
    assert math.isnan(steady.pitch_hz) and math.isnan(steady.pace_hz)
    faint = manner_of(in_room(pulses(150.0), level=0.1), "a cat")
    assert faint.loudness_db < 10 and math.isnan(faint.pitch_range_st) and math.isnan(faint.pace_hz)
    silent = manner_of(Recording(np.zeros(RATE_HZ, np.float32)), "a cat")
    assert math.isnan(silent.loudness_db) and math.isnan(silent.pace_hz)
    made = manner_of(Recording(np.pad(pulses(150.0), RATE_HZ)), "")  # between pauses of zeros
    assert math.isnan(made.loudness_db) and math.isnan(made.pace_hz) and made.pitch_hz == pytest.approx(150, rel=0.01)


@pytest.mark.parametrize(
    ("words", "expected"),
    [("a cat", 2), ("a house", 2), ("a bicycle", 4), ("two apples", 3), ("please paint a whale", 4), ("", 0),
     ("a cat, a dog", 4), ("Three Bees", 2), ("horses, whales and apples", 6)],
)  # fmt: skip
def test_syllables_of_words(words: str, expected: int) -> None:
    assert syllables(words) == expected


@pytest.mark.skipif(ESPEAK is None, reason="needs espeak-ng")
def test_pace_rises_with_the_words_a_minute(tmp_path: Path) -> None:
    words = "a horse in front of a castle"
    paces = []
    for rate in (100, 150, 220):
        read = read_recording(speak(words, tmp_path / "spoken.wav", words_per_minute=rate))
        paces.append(manner_of(in_room(read.samples), words).pace_hz)
    assert paces[0] < 0.8 * paces[1] < 0.8 * 0.8 * paces[2]
