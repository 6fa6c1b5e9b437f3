"""Drawings of Google's Quick, Draw!: newline-delimited JSON, one drawing a line, y down.

`drawing` is a list of strokes [[x…], [y…], [t in ms…]]; the simplified release lacks times.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from pentimento.contracts.errors import ContractError
from pentimento.handwriting.recording import Recording, recording


def read_quickdraw(path: Path, session: str, hand: str, unit_m: float) -> list[Recording]:
    """All strokes of a file; each drawing is a session of its own, since each is another person's.

    Args:
        unit_m: length of a pixel; the drawings do not say on what they were made.

    Raises:
        ContractError: a line (it is named) is no such drawing.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ContractError(f"{path} cannot be read: {error}.") from error
    found = []
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            strokes = [np.array(stroke, dtype=np.float64) for stroke in json.loads(line)["drawing"]]
        except (ValueError, KeyError, TypeError) as error:
            raise ContractError(f"{path}, line {number} is no drawing of Quick, Draw!: {error!r}.") from error
        for stroke in strokes:
            if stroke.ndim != 2 or len(stroke) not in (2, 3):
                raise ContractError(f"{path}, line {number}: a stroke is [x, y] or [x, y, t], each as long.")
            t = stroke[2] / 1e3 if len(stroke) == 3 else None
            found.append(recording(f"{session}_{number}", hand, stroke[:2].T * np.array([unit_m, -unit_m]), t))
    return found
