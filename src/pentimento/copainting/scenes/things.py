"""Kinds of things as simple drawings, recognisable at 64 px and as black outlines.

A drawing is defined in a unit square, x to the right and y down, as parts from back to front. A part is a filled
outline or an open line. Its tone states how its colour derives from the colour of the thing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

Tone = Literal["own", "dark", "light", "white"]


@dataclass(frozen=True, eq=False)
class Part:
    """A filled outline (`width` 0) or an open line of that width, in units of the square."""

    points: NDArray[np.float64]
    """[n, 2]: x, y."""
    tone: Tone
    width: float = 0.0


def _shape(tone: Tone, *points: tuple[float, float]) -> Part:
    return Part(np.array(points), tone)


def _line(tone: Tone, width: float, *points: tuple[float, float]) -> Part:
    return Part(np.array(points), tone, width)


def _arc(
    x: float, y: float, rx: float, ry: float, start_deg: float = 0.0, end_deg: float = 360.0
) -> list[tuple[float, float]]:
    """Points of an ellipse from one angle to another, clockwise on the screen from +x."""
    angles = np.radians(np.linspace(start_deg, end_deg, 25))
    return [(float(x + rx * np.cos(a)), float(y + ry * np.sin(a))) for a in angles]


def _disc(tone: Tone, x: float, y: float, rx: float, ry: float | None = None) -> Part:
    return _shape(tone, *_arc(x, y, rx, rx if ry is None else ry))


def _wheel(x: float, y: float, around: int, inner: float, outer: float, turn_deg: float) -> list[tuple[float, float]]:
    """The outline of a star: `around` points at radius `outer`, with points at radius `inner` between them."""
    angles = np.radians(turn_deg + np.arange(2 * around) * 180 / around)
    radii = np.where(np.arange(2 * around) % 2 == 0, outer, inner)
    return [(float(x + r * np.cos(a)), float(y + r * np.sin(a))) for a, r in zip(angles, radii, strict=True)]


def _rays() -> tuple[Part, ...]:
    angles = np.radians(np.arange(8) * 45.0)
    return tuple(
        _line("own", 0.06, (0.5 + 0.34 * c, 0.5 + 0.34 * s), (0.5 + 0.5 * c, 0.5 + 0.5 * s))
        for c, s in zip(np.cos(angles), np.sin(angles), strict=True)
    )


def _petals() -> tuple[Part, ...]:
    angles = np.radians(np.arange(6) * 60.0 + 30)
    return tuple(
        _disc("own", 0.5 + 0.2 * float(np.cos(a)), 0.29 + 0.2 * float(np.sin(a)), 0.12)
        for a in angles
    )  # fmt: skip


DRAWINGS: Final[dict[str, tuple[Part, ...]]] = {
    "house": (
        _shape("own", (0.12, 0.45), (0.88, 0.45), (0.88, 1), (0.12, 1)),
        _shape("dark", (0, 0.47), (0.5, 0), (1, 0.47)),
        _shape("white", (0.55, 0.6), (0.75, 0.6), (0.75, 0.78), (0.55, 0.78)),
        _shape("dark", (0.24, 0.62), (0.42, 0.62), (0.42, 1), (0.24, 1)),
    ),
    "tree": (
        _shape("dark", (0.42, 0.55), (0.58, 0.55), (0.6, 1), (0.4, 1)),
        _shape(
            "own",
            *_arc(0.5, 0.2, 0.24, 0.2, 200, 340),
            *_arc(0.76, 0.42, 0.22, 0.22, -70, 110),
            *_arc(0.24, 0.42, 0.22, 0.22, 70, 250),
        ),
    ),
    "boat": (
        _line("dark", 0.05, (0.5, 0.02), (0.5, 0.72)),
        _shape("light", (0.55, 0.05), (0.94, 0.6), (0.55, 0.6)),
        _shape("light", (0.45, 0.18), (0.45, 0.6), (0.14, 0.6)),
        _shape("own", (0, 0.7), (1, 0.7), (0.8, 1), (0.2, 1)),
    ),
    "sun": (*_rays(), _disc("own", 0.5, 0.5, 0.26)),
    "moon": (_shape("own", *_arc(0.5, 0.5, 0.5, 0.5, 60, 300), *_arc(0.72, 0.5, 0.4, 0.4, 275, 85)),),
    "star": (_shape("own", *_wheel(0.5, 0.53, 5, 0.22, 0.52, -90)),),
    "cloud": (
        _shape(
            "own",
            *_arc(0.22, 0.62, 0.22, 0.2, 90, 240),
            *_arc(0.45, 0.42, 0.25, 0.24, 190, 330),
            *_arc(0.76, 0.6, 0.24, 0.22, -80, 90),
        ),
    ),
    "mountain": (
        _shape("own", (0, 1), (0.36, 0.1), (0.56, 0.52), (0.7, 0.3), (1, 1)),
        _shape("white", (0.36, 0.1), (0.48, 0.36), (0.4, 0.3), (0.34, 0.4), (0.25, 0.37)),
    ),
    "flower": (
        _line("dark", 0.06, (0.5, 0.4), (0.5, 1)),
        _shape("dark", (0.5, 0.9), (0.62, 0.66), (0.86, 0.62), (0.78, 0.8)),
        *_petals(),
        _disc("light", 0.5, 0.29, 0.12),
    ),
    "fish": (
        _shape("dark", (0.66, 0.5), (1, 0.2), (0.93, 0.5), (1, 0.8)),
        _shape("own", *_arc(0.38, 0.5, 0.38, 0.27)),
        _line("dark", 0.04, (0.3, 0.3), (0.36, 0.5), (0.3, 0.7)),
        _disc("dark", 0.15, 0.44, 0.05),
    ),
    "bird": (
        _shape("dark", (0.7, 0.6), (1, 0.42), (0.98, 0.62), (0.8, 0.74)),
        _line("dark", 0.04, (0.45, 0.8), (0.42, 1)),
        _line("dark", 0.04, (0.58, 0.8), (0.58, 1)),
        _shape("own", *_arc(0.52, 0.62, 0.32, 0.22)),
        _disc("own", 0.26, 0.34, 0.19),
        _shape("dark", (0.1, 0.28), (-0.08, 0.37), (0.1, 0.44)),
        _shape("light", (0.42, 0.55), (0.78, 0.52), (0.6, 0.76)),
        _disc("dark", 0.23, 0.3, 0.045),
    ),
    "cat": (
        _line("own", 0.09, (0.78, 0.85), (0.95, 0.7), (0.92, 0.45)),
        _shape("own", *_arc(0.52, 0.75, 0.3, 0.3, 180, 360), (0.82, 1), (0.22, 1)),
        _shape("own", (0.2, 0.28), (0.18, -0.02), (0.4, 0.12), (0.56, 0.12), (0.76, -0.02), (0.76, 0.28)),
        _shape("own", *_arc(0.48, 0.32, 0.29, 0.24)),
        _disc("dark", 0.37, 0.27, 0.045),
        _disc("dark", 0.59, 0.27, 0.045),
        _shape("dark", (0.44, 0.38), (0.52, 0.38), (0.48, 0.44)),
    ),
    "car": (
        _shape("own", (0, 0.55), (0.2, 0.5), (0.34, 0.24), (0.72, 0.24), (0.86, 0.5), (1, 0.56), (1, 0.78), (0, 0.78)),
        _shape("white", (0.3, 0.5), (0.39, 0.32), (0.51, 0.32), (0.51, 0.5)),
        _shape("white", (0.57, 0.5), (0.57, 0.32), (0.68, 0.32), (0.77, 0.5)),
        _disc("dark", 0.24, 0.78, 0.14),
        _disc("dark", 0.77, 0.78, 0.14),
    ),
    "cup": (
        _line("own", 0.09, (0.68, 0.36), (0.94, 0.38), (0.94, 0.62), (0.64, 0.7)),
        _shape("own", (0.06, 0.22), (0.74, 0.22), (0.64, 0.92), (0.16, 0.92)),
        _shape("light", *_arc(0.4, 0.22, 0.34, 0.1)),
    ),
    "apple": (
        _line("dark", 0.06, (0.5, 0.3), (0.56, 0.04)),
        _shape("light", (0.56, 0.16), (0.72, 0.02), (0.92, 0.06), (0.76, 0.2)),
        _shape("own", *_arc(0.3, 0.58, 0.28, 0.34, 60, 300), (0.5, 0.34), *_arc(0.7, 0.58, 0.28, 0.34, -120, 120)),
    ),
    "mushroom": (
        _shape("light", (0.36, 0.5), (0.64, 0.5), (0.7, 1), (0.3, 1)),
        _shape("own", *_arc(0.5, 0.54, 0.5, 0.5, 180, 360)),
        _disc("white", 0.3, 0.34, 0.08),
        _disc("white", 0.58, 0.24, 0.09),
        _disc("white", 0.77, 0.42, 0.06),
    ),
    "umbrella": (
        _line("dark", 0.05, (0.5, 0.3), (0.5, 0.9), (0.58, 0.98), (0.68, 0.9)),
        _shape(
            "own",
            *_arc(0.5, 0.5, 0.5, 0.46, 180, 360),
            (0.92, 0.42),
            (0.83, 0.42),
            (0.67, 0.5),
            (0.58, 0.42),
            (0.42, 0.42),
            (0.33, 0.5),
            (0.17, 0.42),
            (0.08, 0.42),
        ),
    ),
    "balloon": (
        _line("dark", 0.035, (0.5, 0.66), (0.44, 0.78), (0.54, 0.88), (0.48, 1)),
        _shape("own", (0.42, 0.7), (0.5, 0.6), (0.58, 0.7)),
        _disc("own", 0.5, 0.32, 0.29, 0.33),
        _disc("white", 0.4, 0.2, 0.06, 0.08),
    ),
    "kite": (
        _line("dark", 0.035, (0.4, 0.7), (0.52, 0.8), (0.5, 0.9), (0.64, 1)),
        _shape("own", (0.46, 0), (0.86, 0.26), (0.4, 0.72), (0.1, 0.26)),
        _line("dark", 0.035, (0.46, 0), (0.4, 0.72)),
        _line("dark", 0.035, (0.1, 0.26), (0.86, 0.26)),
    ),
    "key": (
        _line("own", 0.11, (0.42, 0.5), (0.97, 0.5)),
        _line("own", 0.09, (0.76, 0.5), (0.76, 0.72)),
        _line("own", 0.09, (0.93, 0.5), (0.93, 0.74)),
        _disc("own", 0.24, 0.5, 0.24),
        _disc("white", 0.24, 0.5, 0.11),
    ),
    "chair": (
        _line("own", 0.09, (0.2, 0), (0.2, 1)),
        _line("own", 0.09, (0.8, 0.56), (0.8, 1)),
        _shape("own", (0.16, 0.5), (0.86, 0.5), (0.86, 0.62), (0.16, 0.62)),
        _line("dark", 0.06, (0.2, 0.16), (0.36, 0.14), (0.36, 0.5)),
        _line("dark", 0.05, (0.2, 0.82), (0.8, 0.82)),
    ),
    "lamp": (
        _line("dark", 0.07, (0.5, 0.44), (0.5, 0.92)),
        _shape("own", (0.34, 0.04), (0.66, 0.04), (0.88, 0.5), (0.12, 0.5)),
        _shape("dark", (0.26, 1), (0.34, 0.88), (0.66, 0.88), (0.74, 1)),
    ),
    "clock": (
        _disc("own", 0.5, 0.5, 0.48),
        _disc("white", 0.5, 0.5, 0.36),
        _line("dark", 0.06, (0.5, 0.24), (0.5, 0.5), (0.7, 0.6)),
    ),
    "butterfly": (
        _disc("own", 0.24, 0.3, 0.24, 0.26),
        _disc("own", 0.76, 0.3, 0.24, 0.26),
        _disc("light", 0.3, 0.74, 0.18, 0.2),
        _disc("light", 0.7, 0.74, 0.18, 0.2),
        _line("dark", 0.035, (0.5, 0.3), (0.38, 0.02)),
        _line("dark", 0.035, (0.5, 0.3), (0.62, 0.02)),
        _shape("dark", *_arc(0.5, 0.54, 0.06, 0.34)),
    ),
}
"""The parts of each kind."""

KINDS: Final = tuple(DRAWINGS)
