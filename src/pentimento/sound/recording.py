"""A recording as samples: WAV files of any usual kind become mono at 16 kHz, the rate of speech recognisers."""

from __future__ import annotations

import io
import math
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.io import wavfile
from scipy.signal import resample_poly

from pentimento.contracts.errors import PentimentoError

RATE_HZ: Final = 16_000
"""Samples in a second, after reading."""
MAX_BYTES: Final = 16_000_000
"""Of a file: 30 seconds of stereo at 48 kHz in 32 bits, and some more."""
MAX_S: Final = 30.0
"""Duration of a recording."""

_MIN_S: Final = 0.2
"""No wish is shorter."""
_RATES_HZ: Final = (4_000, 384_000)
"""Sampling rates of speech and of sound cards."""
_FULL: Final = 0.999
"""Magnitude from which on a sample is at the limit of its format."""
_MAX_CLIPPED: Final = 0.02
"""Share of samples at the limit from which on a recording is distorted: speech that just fits has almost none."""

_MIN_RMS: Final = 1e-3
"""Of full scale (-60 dB): a recording without a louder tenth of a second is silent."""


class SoundError(PentimentoError):
    """A recording cannot be read, or nothing that can be used is heard in it."""


@dataclass(frozen=True)
class Recording:
    """Mono sound."""

    samples: NDArray[np.float32]
    """float32 [n], -1 to 1, `RATE_HZ` of them in a second."""

    @property
    def duration_s(self) -> float:
        """Duration [s]."""
        return len(self.samples) / RATE_HZ


def read_recording(path: Path) -> Recording:
    """The recording in a WAV file of integers of 8 to 32 bits or floats, of any number of channels and any usual rate.

    Raises:
        SoundError: the file is missing, too large, damaged or no WAV file; or the recording is too short, too long or
            distorted.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise SoundError(f"{path} {_too_large(path.stat().st_size)}")
        data = path.read_bytes()
    except OSError as error:
        raise SoundError(f"{path} cannot be read ({error.strerror}); name a WAV file.") from error
    return recording_of(data, str(path))


def recording_of(data: bytes, where: str) -> Recording:
    """As `read_recording`, of a file's content; `where` names it in errors."""
    if len(data) > MAX_BYTES:
        raise SoundError(f"{where} {_too_large(len(data))}")
    if not data:
        raise SoundError(f"{where} is empty; record the wish again, as a WAV file.")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", wavfile.WavFileWarning)  # of chunks that hold no sound
            warnings.filterwarnings("error", "Reached EOF", wavfile.WavFileWarning)  # of a file that was cut off
            rate_hz, values = wavfile.read(io.BytesIO(data))
    except Exception as error:  # a damaged header reaches many kinds, from struct.error to MemoryError
        raise SoundError(
            f"{where} is no whole WAV file of plain samples ({error}); save the recording as WAV, 16 bits."
        ) from error
    if not _RATES_HZ[0] <= rate_hz <= _RATES_HZ[1]:
        raise SoundError(f"{where} has {rate_hz} samples in a second; record it at 16,000 to 48,000.")
    levels = _levels(values)
    mono = levels if levels.ndim == 1 else levels.mean(axis=1)
    duration_s = len(mono) / rate_hz
    if duration_s < _MIN_S:
        raise SoundError(f"{where} lasts {duration_s:.2f} s, too short for a wish; record it again.")
    if duration_s > MAX_S:
        raise SoundError(f"{where} lasts {duration_s:.0f} s; say the wish in at most {MAX_S:.0f} s.")
    if not np.isfinite(mono).all():
        raise SoundError(f"{where} has samples that are no numbers; record it again.")
    clipped = float(np.mean(np.abs(levels) >= _FULL))
    if clipped > _MAX_CLIPPED:
        raise SoundError(
            f"{where} is distorted: {clipped:.0%} of its samples are at the limit; lower the microphone's level and "
            "record it again."
        )
    common = math.gcd(rate_hz, RATE_HZ)
    resampled = resample_poly(mono, RATE_HZ // common, rate_hz // common) if rate_hz != RATE_HZ else mono
    return Recording(np.clip(resampled, -1.0, 1.0).astype(np.float32))


def check_level(recording: Recording) -> float:
    """Root mean square of the loudest tenth of a second. Raises SoundError where it is that of silence."""
    loudest = float(_levels_of(recording, 0.1).max())
    if loudest < _MIN_RMS:
        raise SoundError(
            "The recording is silent; check the microphone and its level, and record again. Nothing was painted."
        )
    return loudest


def dynamic_db(recording: Recording) -> float:
    """How much louder its loud parts are than its quiet ones [dB]: the ninth decile of the levels over the first."""
    quiet, loud = np.quantile(_levels_of(recording, 0.05), [0.1, 0.9])
    return float(20 * np.log10(max(loud, 1e-9) / max(quiet, 1e-9)))


def _levels_of(recording: Recording, part_s: float) -> NDArray[np.float64]:
    """Root mean squares of consecutive parts of that duration, without a constant offset."""
    size = round(part_s * RATE_HZ)
    samples = recording.samples.astype(np.float64) - recording.samples.mean()
    return np.sqrt((samples[: len(samples) // size * size].reshape(-1, size) ** 2).mean(axis=1))


def _levels(values: NDArray) -> NDArray[np.float64]:
    """Samples as floats of -1 to 1; SciPy gives 24 bits as the upper ones of 32, and 8 bits without sign."""
    if values.dtype == np.uint8:
        return (values.astype(np.float64) - 128.0) / 128.0
    if np.issubdtype(values.dtype, np.integer):
        return values.astype(np.float64) / -float(np.iinfo(values.dtype).min)
    return values.astype(np.float64)


def _too_large(size: int) -> str:
    return (
        f"has {size / 1e6:.0f} MB, more than the {MAX_BYTES / 1e6:.0f} MB of a spoken wish; record only the wish, at "
        f"most {MAX_S:.0f} s."
    )
