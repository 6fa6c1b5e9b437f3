"""Random strokes for measuring: 20 to 60 px long, gently bent, radii of 1.5 to 5 px, anywhere on a square canvas.

Without PyTorch: `benchmarks.two_computers` runs on a robot's computer.
"""

from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from pentimento.render import PixelStrokes

Kind = Literal["plain", "varying", "pickup"]
T = TypeVar("T")


@dataclass(frozen=True)
class Case:
    """What is rendered, and by how many threads."""

    strokes: int
    points: int
    """Of each path."""
    size_px: int
    """The canvas's width and height."""
    threads: int = 1
    kind: Kind = "plain"
    """plain: density and softness constant along each stroke; varying: not; pickup: plain, and takes up wet paint."""


def arrays_of(case: Case) -> tuple[NDArray[Any], ...]:
    """The inputs of ``as_painting``, float32; pickup is there only where the kind says so.

    Equal strokes, points and size give equal places, whatever the kind.
    """
    rng = np.random.default_rng([case.strokes, case.size_px])
    shape = (1, case.strokes, case.points)
    length, heading = rng.uniform(20, 60, (case.strokes, 1)), rng.uniform(-np.pi, np.pi, (case.strokes, 1))
    t = np.linspace(0, 1, case.points)
    along, across = length * t, length * rng.uniform(-0.3, 0.3, (case.strokes, 1)) * 4 * t * (1 - t)
    x = np.cos(heading) * along - np.sin(heading) * across + rng.uniform(0, case.size_px, (case.strokes, 1))
    y = np.sin(heading) * along + np.cos(heading) * across + rng.uniform(0, case.size_px, (case.strokes, 1))
    radius = np.repeat(rng.uniform(1.5, 5, (1, case.strokes, 1)), case.points, axis=2)
    density = np.repeat(rng.uniform(0.5, 1, (1, case.strokes, 1)), case.points, axis=2)
    softness = np.repeat(rng.uniform(0.2, 1, (1, case.strokes, 1)), case.points, axis=2)
    color, canvas = rng.uniform(0, 1, (1, case.strokes, 3)), np.ones((1, case.size_px, case.size_px, 3))
    pickup: tuple[np.ndarray, ...] = ()
    match case.kind:
        case "plain":
            pass
        case "varying":
            density, softness = rng.uniform(0.5, 1, shape), rng.uniform(0.2, 1, shape)
        case "pickup":
            canvas = np.concatenate([canvas, np.zeros_like(canvas[..., :1])], axis=-1)
            pickup = (rng.uniform(0, 0.5, (1, case.strokes)),)
    arrays = (np.stack([x, y], axis=-1)[None], radius, density, softness, color, canvas, *pickup)
    return tuple(array.astype(np.float32) for array in arrays)


def as_painting(*inputs: T) -> tuple[PixelStrokes[T], T]:
    """Strokes and canvas from points, radius, density, softness, colour, canvas and, where there is any, pickup."""
    return PixelStrokes(*inputs[:5], *inputs[6:]), inputs[5]
