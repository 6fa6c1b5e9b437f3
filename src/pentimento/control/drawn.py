"""What a person draws on the page with a pointer or a pen, as strokes of the studio's tool."""

from __future__ import annotations

import json
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError
from pentimento.robots.motion import timed_path
from pentimento.robots.tools import Tool

FloatArray = NDArray[np.float64]

MAX_BYTES: Final = 200_000
"""Of the JSON of one stroke."""

_STEP_M: Final = 1e-3  # between the points of a path
_LONGEST_M: Final = 0.3  # of a path of a tool with its own ink
_APART_M: Final = 0.2e-3  # minimum distance of neighbouring points
_LONGEST_S: Final = 20.0  # of a path; an envelope allows 30 s
_EDGE: Final = 1e-3  # distance from the sheet's edge, in its sides
_FARTHEST: Final = 1e3  # coordinate or pressure of a point, in its unit: no screen is larger


@dataclass(frozen=True, eq=False)
class DrawnStroke:
    """One stroke of the person's."""

    path: FloatArray
    """[N, 5]: t_s, x_m, y_m, z_m, yaw_rad, canvas frame."""
    color_srgb: FloatArray
    """[3]"""


def drawn_strokes(text: str, tool: Tool, canvas_size_m: tuple[float, float]) -> list[DrawnStroke]:
    """The strokes of a line that a person drew, as long as the tool's paint lasts each. What lies outside the sheet is
    left out, as the person saw it.

    Args:
        text: JSON, `{"points": [[x, y, pressure], ...], "color": [r, g, b]}`; x to the right and y down in shares of
            the canvas, pressure and sRGB from 0 to 1. A tool with its own ink ignores the colour.

    Raises:
        ConfigError: it is something else, or all of it lies outside the sheet.
    """
    points, color = _read(text)
    own = np.array(tool.color_srgb) if tool.color_srgb is not None else color
    pieces = _on_sheet(points)
    if not pieces:
        raise ConfigError("The line that was drawn lies outside the sheet; nothing of it was painted.")
    return [DrawnStroke(path, own) for piece in pieces for path in _paths(piece, tool, canvas_size_m)]


def _on_sheet(points: FloatArray) -> list[FloatArray]:
    """The pieces [N, 3] of a line [M, 3] that lie in the unit square, cut at its edges (Liang and Barsky 1984)."""
    if len(points) == 1:
        return [points] if (np.abs(points[0, :2] - 0.5) <= 0.5).all() else []
    pieces: list[list[FloatArray]] = []
    is_inside = False
    for start, end in pairwise(points):
        step = end - start
        enters, leaves = 0.0, 1.0
        for at, along in zip(start[:2], step[:2], strict=True):
            if along == 0:
                leaves = leaves if 0 <= at <= 1 else -1.0
            else:
                edges = sorted((-at / along, (1 - at) / along))
                enters, leaves = max(enters, edges[0]), min(leaves, edges[1])
        if enters > leaves:
            is_inside = False
            continue
        if not is_inside or enters > 0:
            pieces.append([start + enters * step])
        pieces[-1].append(start + leaves * step)
        is_inside = leaves == 1
    return [np.array(piece) for piece in pieces]


def _paths(points: FloatArray, tool: Tool, canvas_size_m: tuple[float, float]) -> list[FloatArray]:
    """The paths [N, 5] of strokes along a line [M, 3] that lies on the sheet."""
    width, height = canvas_size_m
    places = np.clip(points[:, :2], _EDGE, 1 - _EDGE) * [width, -height] + [0.0, height]
    low, high = tool.press_range_m
    press = low + np.clip(points[:, 2], 0.0, 1.0) * (high - low)
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1)))
    longest = tool.stroke_length_m[1] if tool.dips else _LONGEST_M
    ends = np.linspace(0.0, along[-1], max(1, int(np.ceil(along[-1] / longest))) + 1)
    paths = []
    for start, end in pairwise(ends):
        at = np.linspace(start, end, max(2, round((end - start) / _STEP_M) + 1))
        x, y, depth = (np.interp(at, along, values) for values in (*places.T, press))
        xyz_yaw = _apart(np.stack([x, y, -depth, np.zeros(len(at))], axis=1), inwards_m=width / 2)
        paths += _timed(xyz_yaw, tool)
    return paths


def _apart(xyz_yaw: FloatArray, inwards_m: float) -> FloatArray:
    """The points [N, 4] that are at least `_APART_M` from the last one that is kept; a dot as a short line towards x =
    `inwards_m`.
    """
    kept = [xyz_yaw[0]]
    for point in xyz_yaw[1:]:
        if np.hypot(*(point[:2] - kept[-1][:2])) >= _APART_M:
            kept.append(point)
    if len(kept) == 1:
        step = _STEP_M if kept[0][0] < inwards_m else -_STEP_M
        kept.append(kept[0] + [step, 0.0, 0.0, 0.0])
    return np.array(kept)


def _timed(xyz_yaw: FloatArray, tool: Tool) -> list[FloatArray]:
    """Paths [N, 5] along the points [N, 4], one after the other; sharp bends slow the tool down, so a scribble is
    several."""
    path = timed_path(xyz_yaw, tool.speed_m_s)
    if path[-1, 0] <= _LONGEST_S or len(path) < 4:
        return [path]
    middle = len(path) // 2
    return _timed(xyz_yaw[: middle + 1], tool) + _timed(xyz_yaw[middle:], tool)


def _read(text: str) -> tuple[FloatArray, FloatArray]:
    """Points [N, 3] and a colour [3]."""
    try:
        plain: Any = json.loads(text)
        points = np.array(plain["points"], dtype=np.float64)
        color = np.array(plain.get("color") or (0.0, 0.0, 0.0), dtype=np.float64)
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError) as error:
        raise ConfigError(f"The line that was drawn cannot be read ({error!r}); draw it again.") from error
    if points.ndim != 2 or points.shape[1:] != (3,) or len(points) == 0 or color.shape != (3,):
        raise ConfigError("The line that was drawn needs points of x, y and pressure, and a colour of three numbers.")
    if not (np.isfinite(points).all() and np.isfinite(color).all() and color.min() >= 0 and color.max() <= 1):
        raise ConfigError("The line that was drawn has numbers that are not finite, or a colour outside 0 to 1.")
    if np.abs(points).max() > _FARTHEST:
        raise ConfigError("The line that was drawn has points far outside the sheet; draw it again.")
    return points, color
