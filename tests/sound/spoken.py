"""Test support: speech by espeak-ng, and WAV files."""

from __future__ import annotations

import io
import shutil
import subprocess
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import wavfile

ESPEAK = shutil.which("espeak-ng")
WORDS_PER_MINUTE = 150


def speak(words: str, path: Path, voice: str = "en-us+f2", words_per_minute: int = WORDS_PER_MINUTE) -> Path:
    """A file with spoken words: mono, 16 bits, 22,050 Hz."""
    assert ESPEAK is not None
    subprocess.run([ESPEAK, "-v", voice, "-s", str(words_per_minute), "-w", str(path), words], check=True)
    return path


def wav(samples: NDArray, rate_hz: int) -> bytes:
    """The content of a WAV file; its bits are those of the samples."""
    file = io.BytesIO()
    wavfile.write(file, rate_hz, samples)
    return file.getvalue()


def tone(seconds: float, rate_hz: int, amplitude: float = 0.5, hertz: float = 440.0) -> NDArray[np.float32]:
    """A sine."""
    return (amplitude * np.sin(2 * np.pi * hertz * np.arange(round(seconds * rate_hz)) / rate_hz)).astype(np.float32)
