"""Lengths, transforms and viewports of SVG (SVG 1.1, chapter 7; CSS Transforms 1)."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_LENGTH: Final = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(%|[A-Za-z]*)\s*")
PX_M: Final = 0.0254 / 96
_UNITS: Final = {
    "": 1.0, "px": 1.0, "pt": 96 / 72, "pc": 16.0, "in": 96.0, "cm": 96 / 2.54, "mm": 96 / 25.4, "q": 96 / 101.6
}  # fmt: skip
"""User units in each unit."""
_ANGLES: Final = {"": math.pi / 180, "deg": math.pi / 180, "rad": 1.0, "turn": 2 * math.pi, "grad": math.pi / 200}
_FUNCTION: Final = re.compile(r"\s*,?\s*(\w+)\s*\(([^()]*)\)")
_ALIGNED: Final = re.compile(r"(?:defer\s+)?(none|x(?:Min|Mid|Max)Y(?:Min|Mid|Max))(?:\s+(meet|slice))?")
_PARTS: Final = {"Min": 0.0, "Mid": 0.5, "Max": 1.0}
_SAME: Final = 1e-6
"""Relative difference up to which two scales are the same, apart from rounded numbers."""


class Size(NamedTuple):
    """Width and height of a viewport in user units; NaN where unknown."""

    width: float
    height: float

    @property
    def diagonal(self) -> float:
        """To what percentages refer that are neither along x nor along y."""
        return math.sqrt((self.width**2 + self.height**2) / 2)


def length(text: str, whole: float) -> float:
    """A length in user units; percentages are of ``whole``.

    Raises:
        ValueError: the text is no length, or its unit depends on a font or an unknown size.
    """
    number, unit = _parts(text)
    value = number * (whole / 100 if unit == "%" else _UNITS.get(unit.lower(), math.nan))
    if not math.isfinite(value):
        raise ValueError(f"the length {text!r} is of unknown size")
    return value


def length_m(text: str) -> float:
    """A length in metres.

    Raises:
        ValueError: the text is no length in mm, cm, in, pt, pc or Q.
    """
    number, unit = _parts(text)
    if unit.lower() not in _UNITS or unit.lower() in ("", "px") or not math.isfinite(number):
        raise ValueError(f"{text!r} is no length in mm, cm, in, pt, pc or Q")
    return number * _UNITS[unit.lower()] * PX_M


def _parts(text: str) -> tuple[float, str]:
    match = _LENGTH.fullmatch(text)
    if match is None:
        raise ValueError(f"{text!r} is no length")
    return float(match[1]), match[2]


def moved(x: float, y: float) -> FloatArray:
    """The matrix [3, 3] of a translation."""
    return np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])


def scaled(x: float, y: float) -> FloatArray:
    """The matrix [3, 3] of a scaling."""
    return np.diag([x, y, 1.0])


def transform_of(style: Mapping[str, str]) -> FloatArray:
    """The matrix [3, 3] from an element's coordinates to its parent's.

    Raises:
        ValueError: a property moves the element in a way that is not supported.
    """
    for name in ("translate", "rotate", "scale", "zoom", "offset-path"):
        if style.get(name, "none") not in ("none", "normal", "1" if name == "zoom" else "none"):
            raise ValueError(f"the property {name}: {style[name]} is not supported")
    text = style.get("transform", "none")
    if text in ("none", ""):
        return np.eye(3)
    origin = style.get("transform-origin", "0 0")
    if any(_LENGTH.fullmatch(part) is None or _parts(part)[0] != 0 for part in origin.split()):
        raise ValueError(f"the property transform-origin: {origin} is not supported")
    matrix, place = np.eye(3), 0
    while text[place:].strip():
        match = _FUNCTION.match(text, place)
        if match is None:
            raise ValueError(f"the transform {text[:60]!r} cannot be read")
        matrix = matrix @ _function(match[1], [part for part in re.split(r"[\s,]+", match[2].strip()) if part])
        place = match.end()
    return matrix


def _function(name: str, given: list[str]) -> FloatArray:
    """The matrix of one function of a transform, by SVG's or by CSS's grammar."""
    joined = f"{name}({', '.join(given)})"
    try:
        match name, len(given):
            case "matrix", 6:
                a, b, c, d, e, f = (length(part, math.nan) for part in given)
                return np.array([[a, c, e], [b, d, f], [0.0, 0.0, 1.0]])
            case "translate", 1 | 2:
                x, y = ([length(part, math.nan) for part in given] + [0.0])[:2]
                return moved(x, y)
            case "translateX" | "translateY", 1:
                by = length(given[0], math.nan)
                return moved(by, 0) if name.endswith("X") else moved(0, by)
            case "scale", 1 | 2:
                return scaled(_factor(given[0]), _factor(given[-1]))
            case "scaleX" | "scaleY", 1:
                factor = _factor(given[0])
                return scaled(factor, 1) if name.endswith("X") else scaled(1, factor)
            case "rotate", 1 | 3:
                angle, (x, y) = _angle(given[0]), [length(part, math.nan) for part in given[1:]] or [0.0, 0.0]
                cos, sin = math.cos(angle), math.sin(angle)
                return moved(x, y) @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]) @ moved(-x, -y)
            case ("skewX" | "skewY", 1) | ("skew", 1 | 2):
                tilts = [math.tan(_angle(part)) for part in given] + [0.0]
                x, y = (0.0, tilts[0]) if name == "skewY" else (tilts[0], tilts[1])
                return np.array([[1.0, x, 0.0], [y, 1.0, 0.0], [0.0, 0.0, 1.0]])
    except ValueError as error:
        raise ValueError(f"the transform {joined[:60]!r} cannot be read: {error}") from error
    raise ValueError(f"the transform {joined[:60]!r} is not supported")


def _factor(text: str) -> float:
    return length(text, 1.0)


def _angle(text: str) -> float:
    number, unit = _parts(text)
    if unit.lower() not in _ANGLES:
        raise ValueError(f"{text!r} is no angle")
    return number * _ANGLES[unit.lower()]


def view_box(text: str) -> tuple[float, float, float, float] | None:
    """Left, top, width and height of a viewBox; None where there is none.

    Raises:
        ValueError: it is not four numbers with a width and a height above 0.
    """
    if not text.strip():
        return None
    try:
        left, top, width, height = (float(part) for part in re.split(r"[\s,]+", text.strip()))
    except ValueError:
        raise ValueError(f"the viewBox {text[:60]!r} is not four numbers") from None
    if not (0 < width < math.inf and 0 < height < math.inf and math.isfinite(left) and math.isfinite(top)):
        raise ValueError(f"the viewBox {text[:60]!r} has no size")
    return left, top, width, height


def fitted(box: tuple[float, float, float, float], size: Size, aspect: str) -> FloatArray:
    """The matrix [3, 3] from a viewBox to a viewport of a size at the origin, by `preserveAspectRatio`.

    Raises:
        ValueError: the attribute is unknown, or the content would be cut to fill the viewport (`slice`).
    """
    left, top, width, height = box
    match = _ALIGNED.fullmatch(aspect.strip() or "xMidYMid")
    if match is None:
        raise ValueError(f"preserveAspectRatio {aspect[:60]!r} is unknown")
    x, y = size.width / width, size.height / height
    if match[1] == "none":
        return scaled(x, y) @ moved(-left, -top)
    if match[2] == "slice" and abs(x - y) > _SAME * max(x, y):
        raise ValueError(f"preserveAspectRatio {aspect[:60]!r} cuts the drawing")
    scale = min(x, y)
    spare = _PARTS[match[1][1:4]] * (size.width - scale * width), _PARTS[match[1][5:8]] * (size.height - scale * height)
    return moved(*spare) @ scaled(scale, scale) @ moved(-left, -top)
