"""SVG's path data and the outlines of its basic shapes, flattened to polylines (SVG 1.1, chapters 8 and 9)."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_NUMBER: Final = re.compile(r"[\s,]*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)")
_FLAG: Final = re.compile(r"[\s,]*([01])")
"""A flag of an arc needs no separator after it: `a1 1 0 01.5.5` is 1, 1, 0, 0, 1, .5, .5."""
_COMMAND: Final = re.compile(r"\s*([A-Za-z])")
_ARGUMENTS: Final = {
    "M": "nn", "L": "nn", "H": "n", "V": "n", "C": "nnnnnn", "S": "nnnn", "Q": "nnnn", "T": "nn", "A": "nnnffnn",
    "Z": "",
}  # fmt: skip
"""Numbers (n) and flags (f) after each command."""
_STEPS: Final = 24
"""Segments of a flattened curve, and of a quarter of an ellipse. Strokes are resampled by arc length later."""


def flattened(d: str) -> list[FloatArray]:
    """The subpaths [K, 2] of an SVG path's data, in its own units, y down.

    Raises:
        ValueError: the data is invalid.
    """
    paths: list[list[FloatArray]] = []
    at, control, previous = np.zeros(2), np.zeros(2), ""
    for command, numbers in _commands(d):
        kind = command.upper()
        origin = at if command.islower() else np.zeros(2)
        if kind == "M":
            at = origin + numbers
            paths.append([at])
        elif not paths:
            raise ValueError(f"{d[:40]!r} does not begin with a move")
        elif kind == "Z":
            at = paths[-1][0]
            paths[-1].append(at)
        else:
            if previous == "Z":  # another subpath begins where the last one ended
                paths.append([at])
            reflected = 2 * at - control if previous in ("CS" if kind in "CS" else "QT") and previous else at
            points, control = _segment(kind, numbers, origin, at, reflected)
            paths[-1].extend(points)
            at = paths[-1][-1]
        previous = kind
    return [np.array(points) for points in paths if len(points) > 1]


def _commands(d: str) -> Iterator[tuple[str, FloatArray]]:
    """Commands with their numbers. A command that repeats its numbers is repeated; moves go on as lines."""
    command, place, end = "", 0, len(d.rstrip())
    while place < end:
        if letter := _COMMAND.match(d, place):
            command, place = letter[1], letter.end()
        elif command in ("", "Z", "z"):
            raise ValueError(f"a number follows {command or 'nothing'} in {d[:40]!r}")
        if command.upper() not in _ARGUMENTS:
            raise ValueError(f"the command {command!r} in {d[:40]!r} is unknown")
        numbers = []
        for argument in _ARGUMENTS[command.upper()]:
            found = (_FLAG if argument == "f" else _NUMBER).match(d, place)
            if found is None:
                raise ValueError(f"the command {command!r} in {d[:40]!r} lacks numbers at {d[place : place + 10]!r}")
            numbers.append(float(found[1]))
            place = found.end()
        yield command, np.array(numbers)
        command = {"M": "L", "m": "l"}.get(command, command)


def places(points: str) -> FloatArray:
    """The corners [K, 2] of a polyline's or polygon's ``points``.

    Raises:
        ValueError: they are not pairs of numbers.
    """
    numbers, place, end = [], 0, len(points.rstrip())
    while place < end:
        found = _NUMBER.match(points, place)
        if found is None:
            raise ValueError(f"{points[:40]!r} is not a list of points")
        numbers.append(float(found[1]))
        place = found.end()
    if len(numbers) % 2:
        raise ValueError(f"{points[:40]!r} has an odd number of coordinates")
    return np.array(numbers).reshape(-1, 2)


def ellipse(cx: float, cy: float, rx: float, ry: float) -> FloatArray:
    """The closed outline [K, 2] of an ellipse, from its rightmost point towards +y."""
    angles = np.linspace(0, 2 * math.pi, 4 * _STEPS + 1)
    outline = np.column_stack([cx + rx * np.cos(angles), cy + ry * np.sin(angles)])
    outline[-1] = outline[0]
    return outline


def rectangle(x: float, y: float, width: float, height: float, rx: float, ry: float) -> FloatArray:
    """The closed outline [K, 2] of a rectangle with corners rounded by radii of at most half its sides."""
    rx, ry = min(rx, width / 2), min(ry, height / 2)
    right, bottom = x + width, y + height
    if rx <= 0 or ry <= 0:
        return np.array([[x, y], [right, y], [right, bottom], [x, bottom], [x, y]])
    quarter = np.linspace(-math.pi / 2, 0, _STEPS + 1)
    centres = [(right - rx, y + ry), (right - rx, bottom - ry), (x + rx, bottom - ry), (x + rx, y + ry)]
    corners = []
    for turns, (cx, cy) in enumerate(centres):
        angle = quarter + turns * math.pi / 2
        corners.append(np.column_stack([cx + rx * np.cos(angle), cy + ry * np.sin(angle)]))
    outline = np.vstack(corners)
    return np.vstack([outline, outline[:1]])


def _segment(
    kind: str, numbers: FloatArray, origin: FloatArray, at: FloatArray, reflected: FloatArray
) -> tuple[list[FloatArray], FloatArray]:
    """Points after ``at``, and the last control point, which a following smooth curve reflects."""
    match kind:
        case "L":
            return [origin + numbers], at
        case "H":
            return [np.array([origin[0] + numbers[0], at[1]])], at
        case "V":
            return [np.array([at[0], origin[1] + numbers[0]])], at
        case "A":
            return _arc(at, numbers, origin + numbers[5:]), at
    controls = [origin + pair for pair in numbers.reshape(-1, 2)]
    if kind in "ST":
        controls.insert(0, reflected)
    return _bezier([at, *controls]), controls[-2]


def _bezier(controls: list[FloatArray]) -> list[FloatArray]:
    """Points of a Bézier curve of any degree, without the first."""
    t = np.linspace(0, 1, _STEPS + 1)[1:, None]
    degree = len(controls) - 1
    terms = (math.comb(degree, n) * (1 - t) ** (degree - n) * t**n * place for n, place in enumerate(controls))
    return list(np.sum(list(terms), axis=0))


def _arc(start: FloatArray, numbers: FloatArray, end: FloatArray) -> list[FloatArray]:
    """Points of an elliptical arc, without the first (SVG 1.1, implementation notes F.6)."""
    rx, ry, turn, large, sweep = abs(numbers[0]), abs(numbers[1]), math.radians(numbers[2]), numbers[3], numbers[4]
    if rx == 0 or ry == 0 or np.allclose(start, end):
        return [end]
    cos, sin = math.cos(turn), math.sin(turn)
    half = np.array([[cos, sin], [-sin, cos]]) @ (start - end) / 2
    grow = math.sqrt(max(1.0, (half[0] / rx) ** 2 + (half[1] / ry) ** 2))
    rx, ry = rx * grow, ry * grow
    crossed = (rx * half[1]) ** 2 + (ry * half[0]) ** 2
    root = math.sqrt(max(0.0, (rx * ry) ** 2 / crossed - 1)) * (1 if bool(large) != bool(sweep) else -1)
    middle = root * np.array([rx * half[1] / ry, -ry * half[0] / rx])
    first, last = (math.atan2((s * half[1] - middle[1]) / ry, (s * half[0] - middle[0]) / rx) for s in (1, -1))
    swept = (last - first) % (2 * math.pi)
    angles = first + np.linspace(0, swept if sweep else swept - 2 * math.pi, _STEPS + 1)[1:]
    own = np.column_stack([rx * np.cos(angles), ry * np.sin(angles)]) + middle
    placed = own @ np.array([[cos, sin], [-sin, cos]]) + (start + end) / 2
    placed[-1] = end
    return list(placed)
