"""Motion capture as OptiTrack's Motive exports it: rigid bodies of the canvas and of the pen (thesis 5.3.2).

The pen's tip lies a measured length from the body's pivot. Where it is nearer to the canvas than a threshold, the pen
draws. A body's own axes are x, y up, z; on the canvas that is our x, height and minus y.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.contracts.ranges import above_zero
from pentimento.handwriting.contact import strokes_in_contact
from pentimento.handwriting.recording import Recording

FloatArray = NDArray[np.float64]

_METRES: Final = {"meters": 1.0, "centimeters": 1e-2, "millimeters": 1e-3}
_ROTATION: Final = ("X", "Y", "Z", "W")
_POSITION: Final = ("X", "Y", "Z")


@dataclass(frozen=True)
class OptiTrack:
    """What is not in the file."""

    canvas: str
    """Name of the canvas's rigid body."""
    pen: str
    pen_length_m: float
    """From the pen body's pivot to the tip, as measured with a ruler."""
    tip_axis: tuple[float, float, float]
    """Direction of the tip in the pen body's own axes, e.g. [0, -1, 0]."""
    contact_m: float
    """The pen draws where its tip is lower than this over the canvas."""

    def __post_init__(self) -> None:
        above_zero(self, "pen_length_m", "contact_m")
        if not np.linalg.norm(self.tip_axis) > 0:
            raise ValueError(f"tip_axis is {list(self.tip_axis)}; it must point somewhere.")


def read_optitrack(path: Path, session: str, hand: str, known: OptiTrack) -> list[Recording]:
    """All strokes of a take. Frames in which a body is lost are NaN within a stroke.

    Raises:
        ContractError: the file is no such export, says no unit of length, or lacks one of the bodies.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ContractError(f"{path} cannot be read as a Motive export: {error}.") from error
    to_m = _metres(rows, path)
    head = next((n for n, row in enumerate(rows) if row[:2] == ["Frame", "Time (Seconds)"]), None)
    if head is None or head < 4:
        raise ContractError(f"{path} has no line `Frame,Time (Seconds),…` below its header; export it as CSV again.")
    names, kinds, axes = rows[head - 3], rows[head - 1], rows[head]
    data = [row for row in rows[head + 1 :] if row and row[0]]
    t = _column(data, 1, path)
    pen_at, pen_turn = _body(data, names, kinds, axes, known.pen, path)
    canvas_at, canvas_turn = _body(data, names, kinds, axes, known.canvas, path)
    axis = np.array(known.tip_axis) / np.linalg.norm(known.tip_axis)
    tip = pen_at * to_m + known.pen_length_m * _turned(pen_turn, np.tile(axis, (len(t), 1)))
    own = _turned(canvas_turn * np.array([-1.0, -1.0, -1.0, 1.0]), tip - canvas_at * to_m)
    place, height = np.column_stack([own[:, 0], -own[:, 2]]), own[:, 1]
    return strokes_in_contact(session, hand, place, t, height, known.contact_m)


def _metres(rows: list[list[str]], path: Path) -> float:
    first = rows[0] if rows else []
    said = dict(zip(first[::2], first[1::2], strict=False))
    unit = said.get("Length Units", "")
    if unit.lower() not in _METRES:
        raise ContractError(
            f"{path} says {unit or 'nothing'!r} for its length units; export it with one of {', '.join(_METRES)}."
        )
    return _METRES[unit.lower()]


def _body(
    data: list[list[str]], names: list[str], kinds: list[str], axes: list[str], body: str, path: Path
) -> tuple[FloatArray, FloatArray]:
    """Positions [K, 3] in the file's unit, and quaternions [K, 4] as x, y, z, w."""

    def columns(kind: str, wanted: tuple[str, ...]) -> FloatArray:
        found = {
            axis: n for n, axis in enumerate(axes) if n < min(len(names), len(kinds))
            and names[n] == body and kinds[n] == kind
        }  # fmt: skip
        if not set(wanted) <= set(found):
            present = sorted({name for name in names[2:] if name})
            raise ContractError(f"{path} has no {kind} of a rigid body {body!r}; its bodies are {present}.")
        return np.column_stack([_column(data, found[axis], path) for axis in wanted])

    return columns("Position", _POSITION), columns("Rotation", _ROTATION)


def _column(data: list[list[str]], number: int, path: Path) -> FloatArray:
    """[K] numbers; NaN where a cell is empty, as where a body was lost."""
    try:
        return np.array([float(row[number]) if number < len(row) and row[number] else np.nan for row in data])
    except ValueError as error:
        raise ContractError(f"{path}, column {number + 1}: {error}; the export is damaged.") from error


def _turned(quaternion: FloatArray, vectors: FloatArray) -> FloatArray:
    """Vectors [K, 3], turned by unit quaternions [K, 4] (x, y, z, w)."""
    along, w = quaternion[:, :3], quaternion[:, 3:]
    twice = 2 * np.cross(along, vectors)
    return np.asarray(vectors + w * twice + np.cross(along, twice))
