"""WAV files of all usual kinds become the same samples; anything else is one sentence."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pentimento.sound.recording import (
    MAX_BYTES,
    RATE_HZ,
    Recording,
    SoundError,
    check_level,
    dynamic_db,
    read_recording,
    recording_of,
)
from tests.sound.spoken import tone, wav


def _24_bits(samples: NDArray, rate_hz: int) -> bytes:
    values = (samples * (2**23 - 1)).astype("<i4").view(np.uint8).reshape(-1, 4)[:, :3].tobytes()
    form = struct.pack("<IHHIIHH", 16, 1, 1, rate_hz, 3 * rate_hz, 3, 24)
    return (
        b"RIFF"
        + struct.pack("<I", 36 + len(values))
        + b"WAVEfmt "
        + form
        + struct.pack("<4sI", b"data", len(values))
        + values
    )


SINE = tone(0.5, 16_000)
KINDS = {
    "8 bits": wav((128 + 127 * SINE).astype(np.uint8), RATE_HZ),
    "16 bits": wav((32767 * SINE).astype(np.int16), RATE_HZ),
    "24 bits": _24_bits(SINE, RATE_HZ),
    "32 bits": wav((SINE * (2.0**31 - 1)).astype(np.int32), RATE_HZ),
    "floats": wav(SINE, RATE_HZ),
    "doubles": wav(SINE.astype(np.float64), RATE_HZ),
    "stereo": wav(np.stack([SINE, SINE], axis=1), RATE_HZ),
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_samples_gives_the_same_sound(kind: str) -> None:
    recording = recording_of(KINDS[kind], kind)
    assert recording.samples.dtype == np.float32 and recording.duration_s == 0.5
    step = 1 / 64 if kind == "8 bits" else 1e-4
    np.testing.assert_allclose(recording.samples, SINE, atol=step)


@pytest.mark.parametrize("rate_hz", [8_000, 11_025, 22_050, 44_100, 48_000, 96_000])
def test_every_rate_gives_the_same_tone(rate_hz: int) -> None:
    recording = recording_of(wav(tone(0.5, rate_hz), rate_hz), "tone")
    assert abs(recording.duration_s - 0.5) < 1e-3
    inner = slice(500, 7500)  # the filter of resampling takes silence beyond the ends
    np.testing.assert_allclose(recording.samples[inner], tone(0.5, RATE_HZ)[inner], atol=5e-3)


def test_channels_are_averaged() -> None:
    stereo = np.stack([SINE, -SINE], axis=1)
    assert np.abs(recording_of(wav(stereo, RATE_HZ), "stereo").samples).max() < 1e-6


WHOLE = KINDS["16 bits"]
AT = WHOLE.index(b"data") + 4
STREAMED = WHOLE[:4] + b"\xff" * 4 + WHOLE[8:AT] + b"\xff" * 4 + WHOLE[AT + 4 :]
"""As a pipe writes it, which knows no length."""
NOISE = np.clip(np.random.default_rng(0).normal(0, 1, 8000), -1, 1).astype(np.float32)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "is empty"),
        (b"a song, but in words", "no whole WAV file"),
        (b"\x89PNG\r\n\x1a\n" + bytes(100), "no whole WAV file"),
        (WHOLE[:20], "no whole WAV file"),
        (WHOLE[:1000], "no whole WAV file"),
        (WHOLE[:-1], "no whole WAV file"),
        (WHOLE[:20] + struct.pack("<H", 0x55) + WHOLE[22:], "no whole WAV file"),  # MP3 in a WAV file
        (STREAMED, "no whole WAV file"),
        (wav(SINE[:100], RATE_HZ), "too short"),
        (wav(np.zeros(40 * 8000, np.int16), 8000), "at most 30 s"),
        (wav(tone(0.5, 16_000), 1_000_000), "1000000 samples in a second"),
        (wav(np.full(8000, np.nan, np.float32), RATE_HZ), "no numbers"),
        (wav(NOISE, RATE_HZ), "distorted"),
    ],
    ids=["empty", "text", "picture", "header", "half", "one byte less", "compressed", "streamed", "short", "long",
         "rate", "nan", "clipped"],
)  # fmt: skip
def test_bad_files_are_one_sentence(content: bytes, says: str, tmp_path: Path) -> None:
    path = tmp_path / "wish.wav"
    path.write_bytes(content)
    with pytest.raises(SoundError, match=says) as error:
        read_recording(path)
    assert str(path) in str(error.value) and "\n" not in str(error.value)


def test_large_missing_and_other_files_are_one_sentence(tmp_path: Path) -> None:
    large = tmp_path / "large.wav"
    with large.open("wb") as file:
        file.truncate(100_000_000)  # sparse: nothing of it is read
    with pytest.raises(SoundError, match="100 MB"):
        read_recording(large)
    with pytest.raises(SoundError, match="16 MB"):
        recording_of(bytes(MAX_BYTES + 1), "The upload")
    for path in (tmp_path / "nowhere.wav", tmp_path):
        with pytest.raises(SoundError, match="cannot be read"):
            read_recording(path)


@pytest.mark.parametrize("at", range(0, 44, 3))
def test_a_damaged_header_is_read_or_refused(at: int) -> None:
    for value in (0, 1, 0x7F, 0xFF):
        content = WHOLE[:at] + bytes([value]) + WHOLE[at + 1 :]
        try:
            assert np.abs(recording_of(content, "It").samples).max() <= 1
        except SoundError as error:
            assert "It " in str(error)


def test_speech_that_just_touches_the_limit_is_no_distortion() -> None:
    assert recording_of(wav(tone(0.5, RATE_HZ, amplitude=0.998), RATE_HZ), "loud").duration_s == 0.5


def test_level_is_that_of_the_loudest_part() -> None:
    loud = np.concatenate([np.zeros(8000), tone(0.2, 16_000), np.zeros(8000)]).astype(np.float32)
    assert abs(check_level(Recording(loud)) - 0.5 / np.sqrt(2)) < 0.01
    with pytest.raises(SoundError, match="silent"):
        check_level(Recording(0.001 * loud))
    with pytest.raises(SoundError, match="silent"):
        check_level(Recording(np.full(8000, 0.3, np.float32)))  # an offset is no sound


def test_dynamic_is_that_of_loud_and_quiet_parts() -> None:
    rng = np.random.default_rng(0)
    steady = Recording((0.1 * rng.normal(size=32_000)).astype(np.float32))
    assert dynamic_db(steady) < 3
    halves = np.repeat([0.01, 0.1], 16_000) * rng.normal(size=32_000)
    assert abs(dynamic_db(Recording(halves.astype(np.float32))) - 20) < 1
