"""An SVG drawing as the plan of a painting: its lines, fitted to the canvas, are the robot's strokes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import ImageColor

from pentimento.contracts.colour import srgb_to_linear
from pentimento.contracts.errors import ContractError, EnvelopeViolation
from pentimento.control.safety import SafetyEnvelope
from pentimento.planning.strokes.fixed import FixedStrokes, fixed_strokes
from pentimento.robots.tools import Tool
from pentimento.svg.drawing import Drawing, NoSizeError, read_drawing

FloatArray = NDArray[np.float64]

_SAME = 1 + 1e-6
"""Factor by which a page may be larger than the canvas, by rounded numbers."""


@dataclass(frozen=True, eq=False)
class DrawnPlan:
    """A drawing as strokes of a tool."""

    strokes: FixedStrokes
    palette_srgb: FloatArray
    """[K, 3] the colours of the drawing in the order of their first use, or the tool's own ink."""
    sentence: str
    """How it lies on the canvas, for the person."""


def drawn_plan(path: Path, tool: Tool, canvas_size_m: tuple[float, float], envelope: SafetyEnvelope) -> DrawnPlan:
    """Read a drawing and fit its page to the canvas.

    A page that says its size in millimetres (or cm, in, pt, pc, Q) and is no larger than the canvas keeps it: its lower
    left corner lies on the canvas's. Any other page is scaled to the canvas and centred; without a page, the box
    around all lines is. Proportions stay. A tool with its own ink ignores the colours.

    Raises:
        ContractError: the file cannot be read as SVG, or has a colour that is none.
        EnvelopeViolation: a stroke would leave the safety envelope; the sentence names it.
    """
    drawing, has_size = _read(path)
    left, bottom, width, height = drawing.page_m or _box(drawing, tool.nominal_width_m)
    fits = width <= _SAME * canvas_size_m[0] and height <= _SAME * canvas_size_m[1]
    if has_size and fits:
        scale, shift = 1.0, np.zeros(2)
    else:
        scale = min(canvas_size_m[0] / width, canvas_size_m[1] / height)
        shift = (np.array(canvas_size_m) - scale * np.array([width, height])) / 2
    lines = [scale * (line.points - [left, bottom]) + shift for line in drawing.lines]
    colors = np.array([_srgb(line.paint, path, tool) for line in drawing.lines])
    strokes = fixed_strokes(lines, srgb_to_linear(colors), tool)
    for number, stroke in enumerate(strokes.planned(tool, 0), 1):
        try:
            envelope.check_path(stroke.path)
        except EnvelopeViolation as error:
            raise EnvelopeViolation(f"{path}, stroke {number}: {error} Move the line onto the page.") from error
    palette = np.array(list(dict.fromkeys(map(tuple, colors.tolist()))))
    return DrawnPlan(strokes, palette, _sentence(len(strokes), width, height, scale, has_size and fits))


def _read(path: Path) -> tuple[Drawing, bool]:
    """The drawing, and whether it says its size; else its user units count as metres."""
    try:
        return read_drawing(path, None), True
    except NoSizeError:
        return read_drawing(path, 1.0), False


def _box(drawing: Drawing, margin: float) -> tuple[float, float, float, float]:
    """Left, bottom, width and height of all lines; of a single point, a square around it."""
    points = np.concatenate([line.points for line in drawing.lines])
    (left, bottom), (width, height) = points.min(0).tolist(), np.ptp(points, axis=0).tolist()
    return left, bottom, width or margin, height or margin


def _srgb(paint: str, path: Path, tool: Tool) -> tuple[float, ...]:
    if tool.color_srgb is not None:
        return tuple(tool.color_srgb)
    try:
        return tuple(value / 255 for value in ImageColor.getrgb(paint.strip())[:3])
    except ValueError as error:
        raise ContractError(
            f"{path} draws a line in {paint[:60]!r}, which is no colour; give it one, such as #204080."
        ) from error


def _sentence(strokes: int, width: float, height: float, scale: float, keeps_size: bool) -> str:
    if keeps_size:
        return f"The drawing of {1e3 * width:.4g} x {1e3 * height:.4g} mm has {strokes} strokes, at its own size."
    size = f"{1e3 * scale * width:.4g} x {1e3 * scale * height:.4g} mm"
    return f"The drawing has {strokes} strokes; it is scaled to {size}, as large as the canvas allows."
