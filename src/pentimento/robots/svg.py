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
from pentimento.robots.hardware import STIR_M, WIPE_M, WIPES
from pentimento.robots.rig import Palette
from pentimento.robots.tools import Tool

FloatArray = NDArray[np.float64]

_INKSCAPE = "http://www.inkscape.org/namespaces/inkscape"
"""Namespace of the attributes that make a group a layer."""
_WASH = "#808080"
"""Colour of the visits to the water and to the cloth."""


class SvgPlotter:
    """A Robot that draws each stroke as one SVG path; `close()` writes the file.

    The drawing's unit is the millimetre and its y runs down, so a canvas point (x, y) lies at
    (1000 x, 1000 (height − y)). Only what touches the canvas (z ≤ 0) is drawn: a lift within a stroke leaves
    a gap, and a stroke entirely in the air makes no path. Press, speed and yaw are not drawn; the line has
    the tool's nominal width.

    Each colour is a layer, as Inkscape and vpype know them, in the order of first use; a layer's strokes are in the
    order in which they were made. Where strokes of several colours overlap, the drawing shows the later layer on top.

    With the places of paints, each dip begins a layer instead, so that a plotter that draws the layers in their order
    refills where the robot did: the layer's first path is the visit to the paint's well, after those to the water and
    to the cloth where the tool was wiped. Wells lie outside the sheet, so a viewer does not show them.
    """

    def __init__(self, path: Path, canvas_size_m: tuple[float, float], places: Palette | None = None) -> None:
        """``places`` of the paints; None for a drawing without visits to them."""
        self._path = Path(path)
        self._canvas_size_m = canvas_size_m
        self._places = places
        self._wash: list[str] = []
        """Visits to the water and to the cloth since the last dip."""
        self._dips = 0
        self._clock_s = 0.0
        self._tool: Tool | None = None
        self._palette_srgb: FloatArray = np.zeros((0, 3))
        self._color_srgb: FloatArray | None = None
        self._layers: dict[str, list[str]] = {}
        """The paths of each layer, by its label."""
        self._layer = ""
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
        if self._places is None:
            return
        if paint >= len(self._places.wells_m):
            raise ContractError(
                f"Paint {paint + 1} has no well: the rig has {len(self._places.wells_m)}; plan with fewer paints."
            )
        self._dips += 1
        color = _hex(self._color_srgb)
        self._layer = f"dip {self._dips} well {paint + 1} {color}"
        visit = self._visit(self._places.wells_m[paint], STIR_M, times=1, color=color)
        self._layers[self._layer] = [*self._wash, visit]
        self._wash = []

    def wipe(self) -> None:
        if self._tool is None or self._tool.dips:
            self._color_srgb = None
        if self._places is not None:
            self._wash = [
                self._visit(self._places.water_m, STIR_M, times=WIPES, color=_WASH),
                self._visit(self._places.cloth_m, WIPE_M, times=WIPES, color=_WASH),
            ]

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
            layer = color if self._places is None else self._layer
            self._layers.setdefault(layer, []).append(self._drawn(data, color))
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
        for number, (label, paths) in enumerate(self._layers.items(), 1):
            name = f'id="layer{number}" inkscape:groupmode="layer" inkscape:label="{number} {label}"'
            lines += [f"<g {name}>", *paths, "</g>"]
        return "\n".join((*lines, "</svg>", ""))

    def _visit(self, place_m: tuple[float, float], length_m: float, *, times: int, color: str) -> str:
        """To and fro along y about a place outside the sheet, as hardware does it."""
        low, high = ([0.0, place_m[0], place_m[1] + side * length_m / 2, 0.0, 0.0] for side in (-1, 1))
        return self._drawn(_path_data(np.array([low, *[high, low] * times]), self._canvas_size_m[1]), color)

    def _drawn(self, data: str, color: str) -> str:
        width_m = 0.0 if self._tool is None else self._tool.nominal_width_m
        return f'<path d={quoteattr(data)} stroke="{color}" stroke-width="{_mm(width_m)}"/>'


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
