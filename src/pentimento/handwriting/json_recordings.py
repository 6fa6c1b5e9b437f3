"""Strokes of a pen tablet: JSON with one object a file.

    {"unit": "mm", "y": "down", "strokes": [[{"x": 1.0, "y": 2.0, "t": 0.0, "pressure": 0.4}, …], …]}

`unit` is that of x and y; a file without it is read only where the unit's length is given. `t` in seconds and
`pressure` in 0..1 may be absent.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError, UnitError
from pentimento.contracts.units import parse_quantity
from pentimento.handwriting.recording import Recording, recording

FloatArray = NDArray[np.float64]


def read_tablet(path: Path, session: str, hand: str, unit_m: float | None) -> list[Recording]:
    """All strokes of a file; y is turned up.

    Args:
        unit_m: length of the file's unit, for one that does not say it.

    Raises:
        ContractError: no such JSON, no unit, or a point without x and y (it is named).
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ContractError(f"{path} cannot be read as JSON: {error}.") from error
    if not isinstance(document, dict) or not isinstance(document.get("strokes"), list):
        raise ContractError(f"{path} is no tablet's recording: an object with a list `strokes` is needed.")
    to_m = _unit(document, unit_m, path)
    up = {"up": 1.0, "down": -1.0}.get(document.get("y", ""))
    if up is None:
        raise ContractError(f'{path} does not say which way y runs; add "y": "down" (as on screens) or "up".')
    return [
        _stroke(points, session, hand, np.array([to_m, up * to_m]), f"{path}, stroke {number}")
        for number, points in enumerate(document["strokes"])
        if points != []
    ]


def _unit(document: dict[str, Any], unit_m: float | None, path: Path) -> float:
    if "unit" in document:
        try:
            return parse_quantity(f"1 {document['unit']}", "m")
        except UnitError as error:
            raise ContractError(f"{path}: {error}") from error
    if unit_m is None:
        raise ContractError(f"{path} does not say the unit of its lengths; give unit_m, the length of one.")
    return unit_m


def _stroke(points: Any, session: str, hand: str, scale: FloatArray, where: str) -> Recording:
    try:
        xy = np.array([[point["x"], point["y"]] for point in points], dtype=np.float64)
        t, pressure = (
            np.array([np.nan if point.get(name) is None else point[name] for point in points], dtype=np.float64)
            for name in ("t", "pressure")
        )
    except (TypeError, KeyError, ValueError, AttributeError) as error:
        raise ContractError(f"{where}: a point lacks a number for x or y ({error!r}).") from error
    return recording(session, hand, xy * scale, t, None, pressure)


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
