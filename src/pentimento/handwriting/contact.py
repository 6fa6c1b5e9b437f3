"""Where a pen draws: a take of its tip, cut into strokes by the tip's height over the canvas (thesis 5.3.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pentimento.handwriting.recording import Recording, recording

FloatArray = NDArray[np.float64]


def strokes_in_contact(
    session: str, hand: str, place_m: FloatArray, t_s: FloatArray, height_m: FloatArray, contact_m: float
) -> list[Recording]:
    """A take's tip, at places [K, 2] and heights [K] over the canvas, cut into what it draws."""
    return [
        recording(session, hand, place_m[part], t_s[part], height_m[part]) for part in _contacts(height_m, contact_m)
    ]  # fmt: skip


def _contacts(height: FloatArray, contact_m: float) -> list[slice]:
    """Runs of frames from the first in which the pen draws to the last before it is seen to be lifted."""
    runs, begun, last = [], -1, -1
    for frame, value in enumerate(height):
        if value < contact_m:
            begun, last = (frame if begun < 0 else begun), frame
        elif np.isfinite(value) and begun >= 0:
            runs.append(slice(begun, last + 1))
            begun = -1
    return [*runs, slice(begun, last + 1)] if begun >= 0 else runs
