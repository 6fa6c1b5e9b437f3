"""A pen plotter's driver: strokes become an SVG drawing in millimetres."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import ContractError
from pentimento.contracts.observations import Photo
from pentimento.robots.driver import MissingAbilityError
from pentimento.robots.tools import Tool

FloatArray = NDArray[np.float64]

_INKSCAPE = "http://www.inkscape.org/namespaces/inkscape"
"""Namespace of the attributes that make a group a layer."""


class SvgPlotter:
    """A Robot that draws each stroke as one SVG path; `close()` writes the file.

    The drawing's unit is the millimetre and its y runs down, so a canvas point (x, y) lies at
    (1000 x, 1000 (height − y)). Only what touches the canvas (z ≤ 0) is drawn: a lift within a stroke leaves
    a gap, and a stroke entirely in the air makes no path. Press, speed and yaw are not drawn; the line has
    the tool's nominal width.

    Each colour is a layer, as Inkscape and vpype know them, in the order of first use; a layer's strokes are in the
    order in which they were made. Where strokes of several colours overlap, the drawing shows the later layer on top.
    """

    def __init__(self, path: Path, canvas_size_m: tuple[float, float]) -> None:
        self._path = Path(path)
        self._canvas_size_m = canvas_size_m
        self._clock_s = 0.0
        self._tool: Tool | None = None
        self._palette_srgb: FloatArray = np.zeros((0, 3))
        self._color_srgb: FloatArray | None = None
        self._layers: dict[str, list[str]] = {}
        """The paths of each colour."""
        self._closed = False

    @property
    def canvas_size_m(self) -> tuple[float, float]:
        return self._canvas_size_m

    @property
    def clock_s(self) -> float:
        """The time that the strokes and waits so far would have taken."""
        return self._clock_s

    def change_tool(self, tool: Tool) -> None:
        if self._tool == tool:
            return
        self._tool = tool
        self._color_srgb = None if tool.color_srgb is None else np.array(tool.color_srgb)

    def load_palette(self, colors_srgb: FloatArray) -> None:
        self._palette_srgb = np.array(colors_srgb, dtype=np.float64).reshape(-1, 3)

    def dip(self, paint: int) -> None:
        if not 0 <= paint < len(self._palette_srgb):
            raise ContractError(
                f"Paint {paint} is not on the palette, which has {len(self._palette_srgb)} paints; "
                "load a palette that holds it."
            )
        self._color_srgb = self._palette_srgb[paint].copy()

    def wipe(self) -> None:
        if self._tool is None or self._tool.dips:
            self._color_srgb = None

    def move(self, path: FloatArray) -> FloatArray:
        """Draw one stroke. A plotter measures nothing, so the result is NaN throughout, [N, 5]."""
        if self._closed:
            raise ContractError(f"The drawing {self._path} is closed; open another SvgPlotter to go on.")
        if self._tool is None:
            raise ContractError("No tool is held; call change_tool before the first stroke.")
        if self._color_srgb is None:
            raise ContractError(f"The {self._tool.name} carries no paint; dip before this stroke.")
        points = np.asarray(path, dtype=np.float64)
        data = _path_data(points, self._canvas_size_m[1])
        if data:
            color = _hex(self._color_srgb)
            self._layers.setdefault(color, []).append(
                f'<path d={quoteattr(data)} stroke="{color}" stroke-width="{_mm(self._tool.nominal_width_m)}"/>'
            )
        self._clock_s += float(points[-1, 0])
        return np.full(points.shape, np.nan)

    def force_n(self) -> FloatArray:
        return np.zeros(0)

    def lift(self) -> None:
        """Nothing to do: a file has no tool to raise."""

    def photo(self) -> Photo:
        raise MissingAbilityError("An SVG plotter has no camera; paint in the open loop or use a robot with one.")

    def scan(self) -> FloatArray:
        raise MissingAbilityError("An SVG plotter has no scanner; use a robot with one.")

    def new_sheet(self) -> None:
        if self._layers:
            raise ContractError(
                f"One SVG file is one sheet and {self._path} has strokes; close it and open another SvgPlotter."
            )

    def wait(self, seconds: float) -> None:
        self._clock_s += seconds

    def close(self) -> None:
        """Write the drawing, whole or not at all. No stroke can follow."""
        atomic_write(self._path, self.document().encode("utf-8"))
        self._closed = True

    def document(self) -> str:
        """The drawing so far."""
        width_mm, height_mm = (_mm(side) for side in self._canvas_size_m)
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="{_INKSCAPE}" '
            f'width="{width_mm}mm" height="{height_mm}mm" viewBox="0 0 {width_mm} {height_mm}" '
            'fill="none" stroke-linecap="round" stroke-linejoin="round">'
        )
        lines = ['<?xml version="1.0" encoding="UTF-8"?>', head]
        for number, (color, paths) in enumerate(self._layers.items(), 1):
            name = f'id="layer{number}" inkscape:groupmode="layer" inkscape:label="{number} {color}"'
            lines += [f"<g {name}>", *paths, "</g>"]
        return "\n".join((*lines, "</svg>", ""))


def _path_data(path: FloatArray, height_m: float) -> str:
    """SVG path data of the pieces of path[N, 5] at or below the surface, cut where z crosses 0."""
    pieces: list[str] = []
    pen_down = False
    for start, end in pairwise(path):
        if start[3] > 0 and end[3] > 0:
            continue
        if not pen_down:
            pieces.append("M" + _point(_landing(start, end), height_m))
        pieces.append("L" + _point(_landing(end, start), height_m))
        pen_down = bool(end[3] <= 0)
    return " ".join(pieces)


def _landing(point: FloatArray, other: FloatArray) -> FloatArray:
    """The point where it touches; else the crossing of the surface on the segment to `other`."""
    if point[3] <= 0:
        return point
    share = point[3] / (point[3] - other[3])
    landing: FloatArray = point + share * (other - point)
    return landing


def _point(point: FloatArray, height_m: float) -> str:
    return f"{_mm(point[1])},{_mm(height_m - point[2])}"


def _mm(length_m: float) -> str:
    """Millimetres to a tenth of a micrometre, without trailing zeros."""
    text = f"{1000 * float(length_m):.4f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _hex(color_srgb: FloatArray) -> str:
    red, green, blue = (round(255 * float(channel)) for channel in color_srgb)
    return f"#{red:02x}{green:02x}{blue:02x}"
