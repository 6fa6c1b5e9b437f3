"""Import of JSON recordings: pen tablets, and the drawings of Google's Quick, Draw!.

A tablet file is one object:

    {"unit": "mm", "y": "down", "strokes": [[{"x": 1.0, "y": 2.0, "t": 0.0, "pressure": 0.4}, …], …]}

`unit` is that of x and y; without it, the length of the unit must be given. `t` in seconds and `pressure` in 0..1 are
optional.

Quick, Draw! is newline-delimited: one drawing a line, y down. `drawing` is a list of strokes [[x…], [y…], [t in ms…]];
the simplified release has no times.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError, UnitError
from pentimento.contracts.units import parse_quantity
from pentimento.handwriting.recording import Recording, plausible, recording

FloatArray = NDArray[np.float64]


def read_tablet(path: Path, session: str, hand: str, unit_m: float | None) -> list[Recording]:
    """All strokes of a tablet file, with y up.

    Args:
        unit_m: length of the file's unit, where the file has no `unit`.

    Raises:
        ContractError: the file is no such JSON, has no unit, has a point without x and y, or is not plausible.
    """
    try:
        document = json.loads(path.read_bytes())  # UTF-8, 16 or 32, with or without a byte order mark
    except (OSError, ValueError, RecursionError) as error:
        raise ContractError(f"{path} cannot be read as JSON: {error}.") from error
    if not isinstance(document, dict) or not isinstance(document.get("strokes"), list):
        raise ContractError(f"{path} is no tablet recording; it must be an object with a list `strokes`.")
    to_m = _unit(document, unit_m, path)
    up = {"up": 1.0, "down": -1.0}.get(str(document.get("y")))
    if up is None:
        raise ContractError(f'{path} has no direction of y; add "y": "down" (as on screens) or "up".')
    scale = np.array([to_m, up * to_m])
    strokes = [
        _stroke(points, session, hand, scale, f"{path}, stroke {number}")
        for number, points in enumerate(document["strokes"])
        if points != []
    ]
    return plausible(path, strokes)


def _unit(document: dict[str, Any], unit_m: float | None, path: Path) -> float:
    if "unit" in document:
        try:
            own_m = parse_quantity(f"1 {document['unit']}", "m")
        except UnitError as error:
            raise ContractError(
                f"{path}: {error} Where its length is known, take `unit` out of the file and give unit_m."
            ) from error
        if unit_m is not None and not np.isclose(unit_m, own_m):
            raise ContractError(f"{path} has the unit {document['unit']!r}, and unit_m is {unit_m}; leave one out.")
        return own_m
    if unit_m is None:
        raise ContractError(f"{path} has no unit of length; give unit_m, the length of its unit in metres.")
    return unit_m


def _stroke(points: Any, session: str, hand: str, scale: FloatArray, where: str) -> Recording:
    try:
        xy = np.array([[point["x"], point["y"]] for point in points], dtype=np.float64)
        t, pressure = (
            np.array([np.nan if point.get(name) is None else point[name] for point in points], dtype=np.float64)
            for name in ("t", "pressure")
        )
        if xy.shape != (len(points), 2) or t.ndim != 1 or pressure.ndim != 1:
            raise ValueError("a list where a number is expected")
    except (TypeError, KeyError, ValueError, AttributeError, OverflowError) as error:
        raise ContractError(
            f"{where}: a point lacks a number for x or y, or has something else for t or pressure ({error!r})."
        ) from error
    return recording(session, hand, xy * scale, t_s=t, z_m=None, pressure=pressure)


def read_quickdraw(path: Path, session: str, hand: str, unit_m: float) -> list[Recording]:
    """All strokes of a Quick, Draw! file. Each drawing is a session of its own, since each is by another person.

    Args:
        unit_m: length of a pixel, which the file does not contain.

    Raises:
        ContractError: a line is no such drawing, which the message names, or the file is not plausible.
    """
    try:
        content = path.read_bytes()
        lines = content.decode(json.detect_encoding(content)).split("\n")  # U+2028 may stand within a line
    except (OSError, UnicodeDecodeError) as error:
        raise ContractError(f"{path} cannot be read: {error}.") from error
    found = []
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            strokes = [np.array(stroke, dtype=np.float64) for stroke in json.loads(line)["drawing"]]
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
            raise ContractError(f"{path}, line {number} is no drawing of Quick, Draw!: {error!r}.") from error
        for stroke in strokes:
            if stroke.ndim != 2 or len(stroke) not in (2, 3):
                raise ContractError(f"{path}, line {number}: a stroke is [x, y] or [x, y, t], each as long.")
            t = stroke[2] / 1e3 if len(stroke) == 3 else None
            found.append(recording(f"{session}_{number}", hand, stroke[:2].T * np.array([unit_m, -unit_m]), t_s=t))
    return plausible(path, found)
