"""Import of SVG drawings as recorded strokes, by the one reader of SVG, `svg.drawing`."""

from __future__ import annotations

from pathlib import Path

from pentimento.handwriting.recording import Recording, recording
from pentimento.svg.drawing import read_drawing


def read_svg(path: Path, session: str, hand: str, unit_m: float | None, *, css_pixels: bool = False) -> list[Recording]:
    """Each subpath of a drawing as a stroke, in the order of drawing. Times and pressures are unknown.

    Arguments and errors are those of `read_drawing`.
    """
    drawing = read_drawing(path, unit_m, css_pixels=css_pixels)
    return [recording(session, hand, line.points) for line in drawing.lines]
