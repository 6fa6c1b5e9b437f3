"""Import of motion capture (thesis 5.3.2): Motive's CSV exports with rigid bodies, and C3D with single markers.

Both give the pose of the canvas and of the pen in each frame. The tip lies at a measured length along the pen. The pen
draws where its tip is nearer to the canvas than a threshold; a take is cut into strokes there.
"""

from __future__ import annotations

import csv
import io
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.ranges import above_zero, at_least
from pentimento.handwriting.recording import Recording, plausible, recording

FloatArray = NDArray[np.float64]

_METRES: Final = {"meters": 1.0, "centimeters": 1e-2, "millimeters": 1e-3}
_ROTATION: Final = ("X", "Y", "Z", "W")
_POSITION: Final = ("X", "Y", "Z")


@dataclass(frozen=True)
class OptiTrack:
    """What a Motive export does not contain. A rigid body's axes are x, y (up) and z: canvas x, height and minus y."""

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
            raise ValueError(f"tip_axis is {list(self.tip_axis)}; it must not be zero.")


def read_optitrack(path: Path, session: str, hand: str, known: OptiTrack) -> list[Recording]:
    """All strokes of a take. Frames in which a body is lost have NaN coordinates.

    Raises:
        ContractError: the file is no Motive export, is cut off, has no unit of length, lacks one of the bodies, or is
            not plausible.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ContractError(f"{path} cannot be read as a Motive export: {error}.") from error
    to_m = _metres(rows, path)
    table = _table(rows, path)
    t = _column(table.data, 1, path)
    pen_at, pen_turn = _body(table, known.pen, path)
    canvas_at, canvas_turn = _body(table, known.canvas, path)
    axis = np.array(known.tip_axis) / np.linalg.norm(known.tip_axis)
    tip = pen_at * to_m + known.pen_length_m * _turned(pen_turn, np.tile(axis, (len(t), 1)))
    own = _turned(canvas_turn * np.array([-1.0, -1.0, -1.0, 1.0]), tip - canvas_at * to_m)
    place, height = np.column_stack([own[:, 0], -own[:, 2]]), own[:, 1]
    strokes = strokes_in_contact(session, hand, place, t_s=t, height_m=height, contact_m=known.contact_m)
    return plausible(path, strokes)


def _metres(rows: list[list[str]], path: Path) -> float:
    header = _header(rows)
    unit = header.get("Length Units", "")
    if unit.lower() not in _METRES:
        raise ContractError(
            f"{path} has the length units {unit or 'nothing'!r}; export it with one of {', '.join(_METRES)}."
        )
    if header.get("Coordinate Space", "Global") != "Global":
        raise ContractError(
            f"{path} has the coordinate space {header['Coordinate Space']!r}; export it with Global coordinates."
        )
    return _METRES[unit.lower()]


def _header(rows: list[list[str]]) -> dict[str, str]:
    first = rows[0] if rows else []
    return dict(zip(first[::2], first[1::2], strict=False))


class _Table(NamedTuple):
    """A Motive export below its header."""

    names: list[str]
    """Of the bodies, one for each column."""
    kinds: list[str]
    """Rotation or Position."""
    axes: list[str]
    data: list[list[str]]
    """[frames][columns]"""


def _table(rows: list[list[str]], path: Path) -> _Table:
    """Find the rows by their labels, because versions of the format have other rows between them."""
    head = next((n for n, row in enumerate(rows) if row[:2] == ["Frame", "Time (Seconds)"]), None)
    names = next((row for row in rows[:head] if len(row) > 1 and row[1].strip() == "Name"), None)
    kinds = next((row for row in rows[:head] if "Position" in row and "Rotation" in row), None)
    if head is None or names is None or kinds is None:
        raise ContractError(
            f"{path} has no lines `Name`, `Rotation … Position` and `Frame,Time (Seconds),…` above its frames; export "
            "it with rigid bodies as CSV again."
        )
    axes, data = rows[head], [row for row in rows[head + 1 :] if any(row)]
    short = next((number for number, row in enumerate(data) if len(row) != len(axes)), None)
    if short is not None:
        raise ContractError(
            f"{path}: line {short + 1} of its frames has {len(data[short])} values in place of {len(axes)}; the file "
            "is cut off or damaged. Export it again."
        )
    frames = _header(rows).get("Total Exported Frames", "")
    if frames.isdecimal() and int(frames) != len(data):
        raise ContractError(f"{path} has {len(data)} of {frames} frames; it is cut off. Export it again.")
    return _Table(names, kinds, axes, data)


_UNIT_NORM: Final = 1e-2
"""Difference of a quaternion's norm from 1 that rounded numbers can have."""


def _body(table: _Table, body: str, path: Path) -> tuple[FloatArray, FloatArray]:
    """Positions [K, 3] in the file's unit, and quaternions [K, 4] as x, y, z, w; NaN where the body was lost."""

    def columns(kind: str, wanted: tuple[str, ...]) -> FloatArray:
        found: dict[str, list[int]] = {axis: [] for axis in wanted}
        for number, names in enumerate(zip(table.names, table.kinds, table.axes, strict=False)):
            if names[:2] == (body, kind) and names[2] in found:
                found[names[2]].append(number)
        if not all(found.values()):
            present = sorted({name for name in table.names[2:] if name})
            raise ContractError(
                f"{path} has no {kind} {', '.join(wanted)} of a rigid body {body!r}; its bodies are {present}."
            )
        if any(len(places) > 1 for places in found.values()):
            raise ContractError(f"{path} has two rigid bodies {body!r}; rename one and export it again.")
        return np.column_stack([_column(table.data, found[axis][0], path) for axis in wanted])

    at, turn = _with_lost(columns("Position", _POSITION)), columns("Rotation", _ROTATION)
    norm = np.linalg.norm(turn, axis=1)
    turn[norm == 0] = np.nan
    if (np.abs(norm[norm > 0] - 1) > _UNIT_NORM).any():
        raise ContractError(f"{path}: the rotations of {body!r} are no unit quaternions; export them as quaternions.")
    return at, turn


def _with_lost(places: FloatArray) -> FloatArray:
    """Places [K, 3] with NaN where the body or marker was lost.

    Systems leave such cells empty, or write one number into all three, mostly 0 or 9999. What stays at one such place
    in all frames is there: a canvas may define the origin.
    """
    stand_in = (places[:, :1] == places).all(axis=1)
    if stand_in.all() and np.ptp(places, axis=0).max(initial=0.0) == 0:
        return places
    return np.asarray(np.where(stand_in[:, None], np.nan, places))


def _column(data: list[list[str]], number: int, path: Path) -> FloatArray:
    """[K] numbers. Empty cells are NaN: the body was lost."""
    try:
        return np.array([float(row[number].strip() or "nan") for row in data])
    except ValueError as error:
        raise ContractError(f"{path}, column {number + 1}: {error}; the export is damaged.") from error


def _turned(quaternion: FloatArray, vectors: FloatArray) -> FloatArray:
    """Vectors [K, 3], rotated by unit quaternions [K, 4] (x, y, z, w)."""
    along, w = quaternion[:, :3], quaternion[:, 3:]
    twice = 2 * np.cross(along, vectors)
    return np.asarray(vectors + w * twice + np.cross(along, twice))


_C3D_METRES: Final = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}


@dataclass(frozen=True)
class C3D:
    """What a C3D file does not contain. Reading it needs the extra `c3d`."""

    canvas: tuple[str, str, str]
    """Labels of three markers: at the canvas's origin, further along its x, and further along its y."""
    raised_m: float
    """Height of these markers' middles over the sheet."""
    pen: tuple[str, str]
    """Labels of the upper and the lower marker on the pen's axis."""
    tip_m: float
    """From the lower marker's middle along the axis to the tip, as measured with a ruler."""
    contact_m: float
    """The pen draws where its tip is lower than this over the sheet."""

    def __post_init__(self) -> None:
        above_zero(self, "contact_m")
        at_least(self, 0, "raised_m", "tip_m")


def read_c3d(path: Path, session: str, hand: str, known: C3D) -> list[Recording]:
    """All strokes of a take. Frames in which a marker is lost have NaN coordinates.

    Raises:
        ContractError: the file is no C3D, is cut off, has no unit of length, lacks one of the markers, or is not
            plausible.
        ConfigError: the extra `c3d` is not installed.
    """
    try:
        import c3d
    except ImportError as error:
        raise ConfigError(f"To read {path}, install the extra: pip install 'pentimento[c3d]' ({error}).") from error
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "No analog data")  # expected, since markers are all that is read
            reader = c3d.Reader(io.BytesIO(path.read_bytes()))
            labels = [label.strip() for label in reader.point_labels]
            unit = str(reader.get("POINT:UNITS").string_value).strip().lower()
            rate_hz = float(reader.point_rate)
            frames = [points for _, points, _ in reader.read_frames()]
            expected = reader.last_frame - reader.first_frame + 1
    except Exception as error:  # the library raises any exception for a damaged file
        raise ContractError(f"{path} cannot be read as C3D: {type(error).__name__}: {error}.") from error
    if unit not in _C3D_METRES:
        raise ContractError(f"{path} has {unit or 'nothing'!r} for its unit of length; it must be m, cm or mm.")
    if not frames or not rate_hz > 0:
        raise ContractError(f"{path} has {len(frames)} frames at {rate_hz} Hz; export the take again.")
    if len(frames) != expected:
        raise ContractError(f"{path} has {len(frames)} of {expected} frames; it is cut off. Export the take again.")
    points = np.stack(frames).astype(np.float64)  # [frames, markers, x y z residual cameras]
    at_m = np.where(points[..., 3:4] < 0, np.nan, points[..., :3] * _C3D_METRES[unit])

    def marker(label: str) -> FloatArray:
        if label not in labels:
            raise ContractError(f"{path} has no marker {label!r}; its markers are {sorted(labels)}.")
        if labels.count(label) > 1:
            raise ContractError(f"{path} has two markers {label!r}; rename one and export the take again.")
        return _with_lost(np.asarray(at_m[:, labels.index(label)]))

    upper, lower = (marker(label) for label in known.pen)
    tip = lower + known.tip_m * _unit(lower - upper)
    origin, along_x, along_y = (marker(label) for label in known.canvas)
    x = _unit(along_x - origin)
    up = _unit(np.cross(x, along_y - origin))
    own = np.stack([((tip - origin) * axis).sum(-1) for axis in (x, np.cross(up, x), up)], axis=-1)
    height = own[:, 2] + known.raised_m
    t_s = np.arange(len(own)) / rate_hz
    strokes = strokes_in_contact(session, hand, own[:, :2], t_s=t_s, height_m=height, contact_m=known.contact_m)
    return plausible(path, strokes)


def _unit(vectors: FloatArray) -> FloatArray:
    """Vectors [K, 3] scaled to length 1. NaN for a zero vector."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0, length, np.nan))


def strokes_in_contact(
    session: str, hand: str, place_m: FloatArray, *, t_s: FloatArray, height_m: FloatArray, contact_m: float
) -> list[Recording]:
    """The strokes of a take whose tip is at places [K, 2] and heights [K] over the canvas."""
    parts = _contacts(height_m, contact_m)
    return [recording(session, hand, place_m[part], t_s=t_s[part], z_m=height_m[part]) for part in parts]


def _contacts(height: FloatArray, contact_m: float) -> list[slice]:
    """Runs of frames in contact. A frame without a known height does not end a run."""
    runs, begun, last = [], -1, -1
    for frame, value in enumerate(height):
        if value < contact_m:
            begun, last = (frame if begun < 0 else begun), frame
        elif np.isfinite(value) and begun >= 0:
            runs.append(slice(begun, last + 1))
            begun = -1
    return [*runs, slice(begun, last + 1)] if begun >= 0 else runs
