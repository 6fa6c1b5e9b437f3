"""A plan's strokes as arrays that an optimiser can move, and as paths that a robot can execute."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb, srgb_to_linear
from pentimento.contracts.plan import PlannedStroke
from pentimento.robots.motion import timed_path
from pentimento.robots.strokes import press_basis, shape_basis, stroke_points
from pentimento.robots.tools import Tool

Array = NDArray[np.float32]
Index = NDArray[np.integer[Any]] | NDArray[np.bool_] | slice


@dataclass(eq=False)
class Strokes:
    """S strokes in SI units, canvas frame, float32; see ``robots.strokes`` for their geometry. Moved in place."""

    middle_m: Array  # [S, 2]
    theta_rad: Array  # [S]
    length_m: Array  # [S]
    bend_m: Array  # [S]
    press_m: Array  # [S, 3] at start, middle, end
    color: Array  # [S, 3] linear light
    inherited: Mapping[str, Array] | None = field(default=None, kw_only=True)
    """[S] each: covariates that depend on the earlier strokes (``planning.strokes.memory``). None: not computed yet."""

    def __len__(self) -> int:
        return len(self.theta_rad)

    def arrays(self) -> tuple[Array, ...]:
        """All six, in the order of the fields."""
        return (self.middle_m, self.theta_rad, self.length_m, self.bend_m, self.press_m, self.color)

    def pick(self, index: Index) -> Strokes:
        """A copy of some strokes, in the order of ``index``. They keep what they inherit."""
        kept = None if self.inherited is None else {name: values[index] for name, values in self.inherited.items()}
        return Strokes(*(array[index].copy() for array in self.arrays()), inherited=kept)

    def joined(self, others: Strokes) -> Strokes:
        """These strokes, then the others; copies. What they inherit together is to be worked out."""
        return Strokes(*(np.concatenate([a, b]) for a, b in zip(self.arrays(), others.arrays(), strict=True)))

    def colored(self, color: Array) -> Strokes:
        """The same strokes in other colours, linear light [S, 3]; the other arrays are shared."""
        return replace(self, color=color)

    def paths(self, points: int) -> Array:
        """Commanded paths [S, N, 5]; times and yaw are 0: see ``planning.strokes.memory.commanded``."""
        path = np.zeros((len(self), points, 5), np.float32)
        path[..., 1], path[..., 2] = self._places(points)
        path[..., 3] = -self.press_m @ _bases(points)[2].T
        return path

    def _places(self, points: int) -> tuple[Array, Array]:
        """Canvas coordinates along the paths, [S, N] each."""
        along_unit, across_unit, _ = _bases(points)
        along, across = self.length_m[:, None] * along_unit, self.bend_m[:, None] * across_unit
        cos, sin = np.cos(self.theta_rad)[:, None], np.sin(self.theta_rad)[:, None]
        return self.middle_m[:, :1] + cos * along - sin * across, self.middle_m[:, 1:] + sin * along + cos * across

    def keep_within(self, tool: Tool, canvas_size_m: tuple[float, float], edge_m: float) -> None:
        """Move each stroke, in place, to the nearest one that the tool can make inside the canvas."""
        np.clip(self.length_m, *tool.stroke_length_m, out=self.length_m)
        low, high = (np.float32(bound) * self.length_m for bound in tool.bend_range)
        np.clip(self.bend_m, low, high, out=self.bend_m)
        np.clip(self.press_m, *tool.press_range_m, out=self.press_m)
        np.clip(self.color, 0.0, 1.0, out=self.color)
        # The path's box must lie on the canvas, with a little to spare for the robot's own tolerance.
        for axis, (place, size) in enumerate(zip(self._places(32), canvas_size_m, strict=True)):
            self.middle_m[:, axis] += np.maximum(edge_m - place.min(1), 0.0)
            self.middle_m[:, axis] -= np.maximum(place.max(1) - (size - edge_m), 0.0)


def no_strokes() -> Strokes:
    """None at all."""
    return Strokes(*(np.zeros((0, *rest), np.float32) for rest in ((2,), (), (), (), (3,), (3,))))


@cache
def _bases(points: int) -> tuple[Array, Array, Array]:
    """Shape along and across [N], and press [N, 3], of the strokes' geometry."""
    along, across = (basis.astype(np.float32) for basis in shape_basis(points))
    return along, across, press_basis(points).astype(np.float32)


def to_planned(strokes: Strokes, tool: Tool, points: int) -> list[PlannedStroke]:
    """The strokes as timed paths that the robot can execute at the tool's speed, dips left to the executor."""
    planned = []
    for i in range(len(strokes)):
        middle, theta, length, bend, press, color = (array[i].astype(np.float64) for array in strokes.arrays())
        yaw = float(theta) + np.pi / 2 if tool.kind == "flat" else 0.0
        xyz_yaw = stroke_points(middle, float(theta), float(length), float(bend), press, _half_turn(yaw), points)
        srgb = linear_to_srgb(color) if tool.color_srgb is None else np.array(tool.color_srgb)
        planned.append(PlannedStroke(timed_path(xyz_yaw, tool.speed_m_s), np.clip(srgb, 0, 1), dip=False))
    return planned


def with_color(strokes: Strokes, color_srgb: Array) -> Strokes:
    """The same strokes in other colours, sRGB [S, 3]."""
    return strokes.colored(srgb_to_linear(color_srgb))


def _half_turn(yaw_rad: float) -> float:
    """The same attitude of a flat tool within a quarter turn of 0."""
    return float((yaw_rad + np.pi / 2) % np.pi - np.pi / 2)
