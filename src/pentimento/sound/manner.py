"""How something is said: loudness, pitch and pace of a recording of speech.

All three are the same for a recording that is louder or quieter as a whole, since nobody knows a microphone's level.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pentimento.sound.recording import RATE_HZ, Recording

FloatArray = NDArray[np.float64]

_HOP: Final = round(0.01 * RATE_HZ)
"""Samples from frame to frame."""
_LEVEL_FRAME: Final = round(0.032 * RATE_HZ)
"""Samples of a frame whose level is measured."""
_SPEECH_HZ: Final = (200.0, 4000.0)
"""Band in which levels are measured: hum and rumble lie below it, hiss above."""
_QUIET: Final = 0.1
"""Quantile of the levels that is the background's: a recording begins and ends with a pause."""
_DIGITAL_SILENCE: Final = 1e-8
"""Power (-80 dB of full scale) below which a background was not recorded, but made or suppressed."""
_ABOVE_DB: Final = 6.0
"""Frames so much louder than the background are speech..."""
_BELOW_DB: Final = 25.0
"""...unless they are so much quieter than loud speech: reverberation, breath."""
_MAX_PAUSE_S: Final = 0.25
"""Longer gaps are pauses, not stops within words (Goldman-Eisler 1968)."""

_PITCH_HZ: Final = (65.0, 500.0)
"""From a low man's voice to an excited child's."""
_PITCH_BAND_HZ: Final = (60.0, 1000.0)
"""Band in which periods are sought: it holds the lower harmonics, and less noise than the whole."""
_PITCH_WINDOW: Final = round(0.025 * RATE_HZ)
_PERIODIC: Final = 0.1
"""Share of the power that is not periodic, below which the shortest lag is the period (de Cheveigné and Kawahara)."""
_APERIODIC: Final = 0.2
"""The same share, from which on a frame is unvoiced."""
_OCTAVE_ERRORS: Final = (0.75, 1.5)
"""Factors of the pitch's first and third quartile, beyond which it is an octave error (De Looze and Hirst 2008)."""
_MIN_VOICED: Final = 10
"""Frames; fewer give no pitch."""
_MIN_LOUDNESS_DB: Final = 10.0
"""Below it noise hides the ends of words, so that neither pace nor pitch range are those of the speech."""

_SILENT_E: Final = re.compile(r"(?<![^aeiouy]l)(?:(?<=[^aeiouy])e|(?<=[^aeiouycghsxz])es)$")
"""As in whale and whales; the e of apple, apples and horses is heard."""


@dataclass(frozen=True)
class Manner:
    """How something was said. NaN stands for what cannot be measured in the recording."""

    loudness_db: float
    """Power of the speech over that of the recording's background [dB]. NaN where that is digital silence."""
    pitch_hz: float
    """Median frequency of the voice."""
    pitch_range_st: float
    """From the first to the ninth decile of the voice's frequency, in semitones."""
    pace_hz: float
    """Syllables in a second, without pauses."""


def manner_of(recording: Recording, words: str) -> Manner:
    """How the words of a recording were said.

    Args:
        words: what was said, in English; their syllables are counted.
    """
    levels = speech_levels(recording)
    speech = is_speech(levels)
    background = float(np.quantile(levels, _QUIET))
    known = background > _DIGITAL_SILENCE and speech.any()
    loudness_db = 10 * math.log10(float(levels[speech].mean()) / background) if known else math.nan
    pitches = pitches_hz(recording)
    count = min(len(pitches), len(speech))
    voiced = pitches[:count][speech[:count] & np.isfinite(pitches[:count])]
    pitch_hz = range_st = pace_hz = math.nan
    if loudness_db < _MIN_LOUDNESS_DB or not speech.any():
        return Manner(loudness_db, pitch_hz, range_st, pace_hz)
    if len(voiced):
        below, above = np.quantile(voiced, [0.25, 0.75]) * _OCTAVE_ERRORS
        voiced = voiced[(voiced >= below) & (voiced <= above)]
    if len(voiced) >= _MIN_VOICED:
        low, pitch_hz, high = (float(value) for value in np.quantile(voiced, [0.1, 0.5, 0.9]))
        range_st = 12 * math.log2(high / low)
    if number := syllables(words):
        pace_hz = number / speaking_s(speech)
    return Manner(loudness_db, pitch_hz, range_st, pace_hz)


def speech_levels(recording: Recording) -> FloatArray:
    """Power of each frame in the band of speech."""
    spectra = np.abs(np.fft.rfft(_frames(recording.samples, _LEVEL_FRAME) * np.hanning(_LEVEL_FRAME))) ** 2
    hertz = np.fft.rfftfreq(_LEVEL_FRAME, 1 / RATE_HZ)
    inside = (hertz >= _SPEECH_HZ[0]) & (hertz <= _SPEECH_HZ[1])
    # Parseval's theorem, for both signs of the frequency and the window's power of 3/8.
    return np.asarray(spectra[:, inside].sum(axis=1) * 2 / (0.375 * _LEVEL_FRAME**2))


def is_speech(levels: FloatArray) -> NDArray[np.bool_]:
    """The frames that stand out of the background."""
    background, loud = np.quantile(levels, [_QUIET, 0.95])
    return np.asarray(levels > max(background * 10 ** (_ABOVE_DB / 10), loud * 10 ** (-_BELOW_DB / 10)))


def speaking_s(speech: NDArray[np.bool_]) -> float:
    """Duration of speech with the stops within words, and without pauses [s]."""
    places = np.flatnonzero(speech)
    if not len(places):
        return 0.0
    steps = np.diff(places)
    return float((1 + steps[steps * _HOP <= _MAX_PAUSE_S * RATE_HZ].sum()) * _HOP / RATE_HZ)


def pitches_hz(recording: Recording) -> FloatArray:
    """Frequency of the voice in each frame; NaN where it is unvoiced.

    YIN (de Cheveigné and Kawahara 2002, "YIN, a fundamental frequency estimator for speech and music"): the shortest
    lag at which the frame differs from itself by little of its power, or else the lag at which it differs least.
    """
    shortest, longest = (round(RATE_HZ / hertz) for hertz in reversed(_PITCH_HZ))
    frames = _frames(_band(recording.samples, _PITCH_BAND_HZ), _PITCH_WINDOW + longest + 1)
    if not len(frames):
        return np.zeros(0)
    size = frames.shape[1]
    first = np.where(np.arange(size) < _PITCH_WINDOW, frames, 0.0)
    product = np.fft.rfft(frames, 2 * size) * np.conj(np.fft.rfft(first, 2 * size))
    together = np.fft.irfft(product)[:, : longest + 2]
    power = np.cumsum(np.pad(frames**2, ((0, 0), (1, 0))), axis=1)
    windows = power[:, _PITCH_WINDOW:] - power[:, :-_PITCH_WINDOW]
    differs = np.maximum(windows[:, :1] + windows[:, : longest + 2] - 2 * together, 0.0)
    lags = np.arange(1, longest + 2)
    total = np.cumsum(differs[:, 1:], axis=1)
    aperiodic = np.where(total > 0, differs[:, 1:] * lags / np.where(total > 0, total, 1.0), 1.0)  # 1 in silence
    found = np.full(len(frames), np.nan)
    for number, row in enumerate(aperiodic):
        possible = row[shortest - 1 : longest]
        if possible.min() >= _APERIODIC:
            continue
        at = shortest - 1 + int(np.argmax(possible < max(_PERIODIC, float(possible.min()) + 1e-12)))
        while at + 1 < longest and row[at + 1] < row[at]:
            at += 1
        found[number] = RATE_HZ / (lags[at] + _vertex(row[at - 1 : at + 2]))
    return found


def syllables(words: str) -> int:
    """Number of syllables in English words: groups of vowels, without a silent e at a word's end. At least 1 a word."""
    stems = (_SILENT_E.sub("", word) for word in re.findall(r"[\w']+", words.lower()))
    return sum(max(len(re.findall(r"[aeiouy]+", stem)), 1) for stem in stems)


def _vertex(three: FloatArray) -> float:
    """Place of the minimum of a parabola through three values at -1, 0 and 1."""
    curve = three[0] - 2 * three[1] + three[2]
    return float(0.5 * (three[0] - three[2]) / curve) if len(three) == 3 and curve > 0 else 0.0


def _band(samples: NDArray[np.float32], band_hz: tuple[float, float]) -> FloatArray:
    spectrum, hertz = np.fft.rfft(samples.astype(np.float64)), np.fft.rfftfreq(len(samples), 1 / RATE_HZ)
    return np.fft.irfft(np.where((hertz >= band_hz[0]) & (hertz <= band_hz[1]), spectrum, 0), len(samples))


def _frames(samples: NDArray, size: int) -> FloatArray:
    """Frames [N, size], one each `_HOP` samples."""
    if len(samples) < size:
        return np.zeros((0, size))
    return np.lib.stride_tricks.sliding_window_view(samples.astype(np.float64), size)[::_HOP]
