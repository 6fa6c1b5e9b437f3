"""Strokes that are a drawing already: lines that no planner moves."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.plan import PlannedStroke
from pentimento.planning.strokes.brush import Brush, Marks
from pentimento.planning.strokes.paths import PlannedPaths, color_of
from pentimento.robots.motion import timed_path
from pentimento.robots.tools import Tool

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

_STEP_M: Final = 1e-3
"""Between the points of a path on a straight line."""
_APART_M: Final = 0.2e-3
"""Minimum distance of neighbouring points, which the robot's clock can tell apart."""
_LONGEST_S: Final = 20.0
"""Of a stroke; an envelope allows 30 s."""
_TURN_RAD: Final = 0.2
"""From this change of heading on a point of a line counts as a corner, which a path keeps."""
_CHUNK: Final = 32
"""Points of a piece of a line that is rendered at once."""
_SOFTNESS: Final = 0.2


@dataclass(eq=False)
class FixedStrokes(PlannedPaths):
    """S strokes along given lines, with a tool's middle press. Their marks are as wide as the tool, and opaque.

    No stroke model is asked: one that was fitted to short strokes would predict a long line poorly.
    """

    row_arrays: ClassVar[tuple[str, ...]] = ("lines", "theta_rad", "color", "width_m")
    holds_covariates: ClassVar[bool] = False
    is_fixed: ClassVar[bool] = True

    lines: NDArray[Any]  # [S] arrays [K, 2], canvas frame
    theta_rad: Array  # [S], 0
    color: Array  # [S, 3] linear light
    width_m: Array  # [S] of the marks
    inherited: Mapping[str, Array] | None = field(default=None, kw_only=True)

    def arrays(self) -> tuple[Array, ...]:
        """The colours: nothing else has a gradient."""
        return (self.color,)

    def paths(self, points: int) -> Array:
        """See ``PlannedPaths``; at the surface."""
        path = np.zeros((len(self), points, 5), np.float32)
        for row, line in zip(path, self.lines, strict=True):
            along = _along(line)
            at = np.linspace(0.0, along[-1], points)
            row[:, 1], row[:, 2] = (np.interp(at, along, values) for values in line.T)
        return path

    def marks(self, brush: Brush, inherited: Mapping[str, Array]) -> tuple[Marks, Callable[[Marks], tuple[Array, ...]]]:
        """Marks of the pieces of all lines, in their order; more than S, so that there is no gradient."""
        pieces = [
            (line[start : start + _CHUNK], stroke)
            for stroke, line in enumerate(self.lines)
            for start in range(0, max(len(line) - 1, 1), _CHUNK - 1)
        ]
        points = np.stack([np.pad(piece, ((0, _CHUNK - len(piece)), (0, 0)), "edge") for piece, _ in pieces])
        stroke = np.array([stroke for _, stroke in pieces])
        radius = np.repeat(self.width_m[stroke, None] / 2, _CHUNK, axis=1).astype(np.float32)
        ones = np.ones_like(radius)
        marks = Marks(points.astype(np.float32), radius, ones, _SOFTNESS * ones, self.color[stroke], None)
        return marks, lambda _: (np.zeros_like(self.color),)

    def keep_within(self, tool: Tool, canvas_size_m: tuple[float, float], edge_m: float) -> None:
        """Nothing: the envelope refuses a drawing that leaves the canvas."""

    def planned(self, tool: Tool, points: int) -> list[PlannedStroke]:
        """See ``PlannedPaths``; the paths have the points of their lines, whatever ``points`` is."""
        return [
            PlannedStroke(_timed(line, tool), color_of(tool, color), dip=False)
            for line, color in zip(self.lines, self.color.astype(np.float64), strict=True)
        ]


def fixed_strokes(lines: Sequence[FloatArray], colors: FloatArray, tool: Tool) -> FixedStrokes:
    """Strokes along lines [K, 2] (canvas frame) in colours [S, 3] (linear light), in their order.

    A line is one stroke, or several in a row where it takes more than 20 s or, with a tool that is dipped, is longer
    than the tool's strokes. Paths keep the lines' corners; their other points are 1 mm apart.
    """
    strokes, owners = list[FloatArray](), list[int]()
    for number, line in enumerate(lines):
        longest_m = tool.stroke_length_m[1] if tool.dips else np.inf
        for piece in _pieces(_sampled(line), longest_m, tool):
            strokes.append(piece)
            owners.append(number)
    return FixedStrokes(
        as_rows(strokes), np.zeros(len(strokes), np.float32), colors[owners].astype(np.float32).reshape(-1, 3),
        np.full(len(strokes), tool.nominal_width_m, np.float32),
    )  # fmt: skip


def as_rows(lines: Sequence[FloatArray]) -> NDArray[Any]:
    """Lines of any length as an array [S] of arrays."""
    rows = np.empty(len(lines), object)
    for row, line in enumerate(lines):  # numpy would join lines of one length
        rows[row] = line
    return rows


def _along(line: FloatArray) -> FloatArray:
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))


def _sampled(line: FloatArray) -> FloatArray:
    """A line [K, 2] with its ends, its corners, and a point every millimetre between them; a dot as 1 mm."""
    line = line[np.append(True, np.any(np.diff(line, axis=0) != 0, axis=1))]
    along = _along(line)
    if along[-1] < _APART_M:
        return np.stack([line[0] - [_STEP_M / 2, 0.0], line[0] + [_STEP_M / 2, 0.0]])
    heading = np.unwrap(np.arctan2(*np.diff(line, axis=0).T[::-1]))
    corners = along[1:-1][np.abs(np.diff(heading)) > _TURN_RAD]
    kept = [0.0]
    for corner in (*corners, along[-1]):
        if corner - kept[-1] >= _APART_M:
            kept.append(float(corner))
    kept[-1] = float(along[-1])
    at = [np.linspace(start, end, max(1, round((end - start) / _STEP_M)) + 1)[:-1] for start, end in pairwise(kept)]
    places = np.append(np.concatenate(at), along[-1])
    return np.stack([np.interp(places, along, values) for values in line.T], axis=1)


def _pieces(line: FloatArray, longest_m: float, tool: Tool) -> list[FloatArray]:
    """A sampled line, or its halves, until each can be made in one stroke."""
    fits = _along(line)[-1] <= longest_m and _timed(line, tool)[-1, 0] <= _LONGEST_S
    if fits or len(line) < 4:
        return [line]
    middle = len(line) // 2
    return _pieces(line[: middle + 1], longest_m, tool) + _pieces(line[middle:], longest_m, tool)


def _timed(line: FloatArray, tool: Tool) -> FloatArray:
    """The path [N, 5] along a sampled line; a flat tool keeps its edge along x."""
    points = np.zeros((len(line), 4))
    points[:, :2] = line
    points[:, 2] = -sum(tool.press_range_m) / 2
    return timed_path(points, tool.speed_m_s)
