"""Arguments of the renderers."""

from typing import TypeVar

from pentimento.render import PixelStrokes

T = TypeVar("T")


def painting(*inputs: T) -> tuple[PixelStrokes[T], T]:
    """Strokes and canvas from points, radius, density, softness, colour, canvas and, where there is any, pickup."""
    return PixelStrokes(*inputs[:5], *inputs[6:]), inputs[5]
