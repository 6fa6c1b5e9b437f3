"""Import of SVG paths as strokes: lines, Bézier curves and arcs, flattened, with y up.

Supported are `path`, `polyline`, `polygon` and `line`, also within groups. A drawing with a `transform` is refused;
flatten it first.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError, UnitError
from pentimento.contracts.units import parse_quantity
from pentimento.handwriting.recording import Recording, recording

FloatArray = NDArray[np.float64]

_TOKEN: Final = re.compile(r"[A-Za-z]|[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_NUMBERS: Final = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}
_STEPS: Final = 24
"""Segments of a flattened curve. Strokes are resampled by arc length later."""


def read_svg(path: Path, session: str, hand: str, unit_m: float | None) -> list[Recording]:
    """Each subpath of a drawing as a stroke, in the order of the file. Times and pressures are unknown.

    Args:
        unit_m: length of a user unit. None: from the drawing's width (mm, cm or in) and its viewBox.

    Raises:
        ContractError: the file is no SVG, has no unit, has a `transform`, or has an invalid path, which is named.
    """
    try:
        root = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise ContractError(f"{path} cannot be read as SVG: {error}.") from error
    to_m = _unit(root, path) if unit_m is None else unit_m
    strokes: list[FloatArray] = []
    for number, element in enumerate(root.iter()):
        if element.get("transform"):
            raise ContractError(f"{path} has an element with a transform; flatten the drawing, then import it.")
        try:
            strokes += _subpaths(element)
        except (ValueError, IndexError) as error:
            raise ContractError(f"{path}, element {number}: {error}; correct or remove it.") from error
    return [recording(session, hand, stroke * np.array([to_m, -to_m])) for stroke in strokes]


def _unit(root: ElementTree.Element, path: Path) -> float:
    box = [float(value) for value in re.split(r"[\s,]+", root.get("viewBox", "").strip()) if value]
    try:
        width_m = parse_quantity(root.get("width", ""), "m")
    except UnitError as error:
        raise ContractError(f"{path} has no width as a length ({error}) Give unit_m instead.") from error
    if len(box) != 4 or not box[2] > 0:
        raise ContractError(f"{path} has no viewBox of four numbers; give unit_m, the length of a user unit.")
    return width_m / box[2]


def _subpaths(element: ElementTree.Element) -> list[FloatArray]:
    match element.tag.rpartition("}")[2]:
        case "path":
            return flattened(element.get("d", ""))
        case "line":
            ends = [float(element.get(name, "0")) for name in ("x1", "y1", "x2", "y2")]
            return [np.array(ends).reshape(2, 2)]
        case "polyline" | "polygon" as kind:
            places = np.array([float(v) for v in _TOKEN.findall(element.get("points", ""))]).reshape(-1, 2)
            return [np.vstack([places, places[:1]]) if kind == "polygon" else places]
    return []


def flattened(d: str) -> list[FloatArray]:
    """The subpaths [K, 2] of an SVG path's data, in its own units, y down.

    Raises:
        ValueError, IndexError: the data is invalid.
    """
    tokens = _TOKEN.findall(d)
    if re.sub(r"[\s,]", "", d) != "".join(tokens):
        raise ValueError(f"{d[:40]!r} is not a path's data")
    paths: list[list[FloatArray]] = []
    at, control, command, previous, k = np.zeros(2), np.zeros(2), "", "", 0
    while k < len(tokens):
        if tokens[k].isalpha():
            command, k = tokens[k], k + 1
        elif command in "Zz":
            raise ValueError(f"a number follows {command or 'nothing'} in {d[:40]!r}")
        kind = command.upper()
        numbers = np.array([float(v) for v in tokens[k : k + _NUMBERS.get(kind, -1)]])
        if kind not in _NUMBERS or len(numbers) < _NUMBERS[kind]:
            raise ValueError(f"the command {command!r} in {d[:40]!r} is unknown or lacks numbers")
        k += _NUMBERS[kind]
        origin = at if command.islower() else np.zeros(2)
        if kind == "M":
            at = origin + numbers
            paths.append([at])
            command = "l" if command == "m" else "L"
        elif not paths:
            raise ValueError(f"{d[:40]!r} does not begin with a move")
        elif kind == "Z":
            at = paths[-1][0]
            paths[-1].append(at)
        else:
            if paths[-1][-1] is not at:  # after Z another subpath begins where the last one ended
                paths.append([at])
            reflected = 2 * at - control if previous in ("CS" if kind in "CS" else "QT") and previous else at
            points, control = _segment(kind, numbers, origin, at, reflected)
            paths[-1].extend(points)
            at = paths[-1][-1]
        previous = kind
    return [np.array(points) for points in paths if len(points) > 1]


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
