"""Bézier strokes (thesis 4.3.1): arrays that an optimiser moves, and paths that a robot executes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import srgb_to_linear
from pentimento.contracts.errors import ConfigError
from pentimento.contracts.plan import PlannedStroke
from pentimento.planning.strokes.paths import PlannedPaths, color_of, half_turn, shift_within
from pentimento.robots.motion import timed_path
from pentimento.robots.strokes import press_basis, shape_basis, stroke_points
from pentimento.robots.tools import Tool

if TYPE_CHECKING:
    from pentimento.planning.strokes.brush import Brush, Marks

Array = NDArray[np.float32]

_BOX_POINTS = 32
"""Points of a path from which its box on the canvas is taken."""


@dataclass(eq=False)
class Strokes(PlannedPaths):
    """S Bézier strokes; ``robots.strokes`` defines their geometry."""

    row_arrays: ClassVar[tuple[str, ...]] = ("middle_m", "theta_rad", "length_m", "bend_m", "press_m", "color")
    holds_covariates: ClassVar[bool] = True

    middle_m: Array  # [S, 2]
    theta_rad: Array  # [S]
    length_m: Array  # [S]
    bend_m: Array  # [S]
    press_m: Array  # [S, 3] at start, middle, end
    color: Array  # [S, 3] linear light
    inherited: Mapping[str, Array] | None = field(default=None, kw_only=True)

    def arrays(self) -> tuple[Array, ...]:
        """All six, in the order of the fields."""
        return (self.middle_m, self.theta_rad, self.length_m, self.bend_m, self.press_m, self.color)

    def paths(self, points: int) -> Array:
        """See ``PlannedPaths``; ``planning.strokes.memory.commanded`` adds times and yaw."""
        path = np.zeros((len(self), points, 5), np.float32)
        path[..., 1], path[..., 2] = self._places(points)
        path[..., 3] = -self.press_m @ _basis(points).press.T
        return path

    def marks(self, brush: Brush, inherited: Mapping[str, Array]) -> tuple[Marks, Callable[[Marks], tuple[Array, ...]]]:
        """See ``PlannedPaths``.

        Raises:
            ConfigError: the brush takes paths only.
        """
        from pentimento.planning.strokes.brush import BezierBrush  # it imports this module

        if not isinstance(brush, BezierBrush):
            raise ConfigError("Bézier strokes need a brush with marks; this one takes paths only.")
        marks, pull = brush.marks(self, inherited)
        return marks, lambda of_marks: pull(of_marks).arrays()

    def keep_within(self, tool: Tool, canvas_size_m: tuple[float, float], edge_m: float) -> None:
        """See ``PlannedPaths``."""
        np.clip(self.length_m, *tool.stroke_length_m, out=self.length_m)
        low, high = (np.float32(bound) * self.length_m for bound in tool.bend_range)
        np.clip(self.bend_m, low, high, out=self.bend_m)
        np.clip(self.press_m, *tool.press_range_m, out=self.press_m)
        np.clip(self.color, 0.0, 1.0, out=self.color)
        shift_within(self._places(_BOX_POINTS), self.middle_m, canvas_size_m, edge_m)

    def planned(self, tool: Tool, points: int) -> list[PlannedStroke]:
        """See ``PlannedPaths``."""
        planned = []
        for i in range(len(self)):
            middle, theta, length, bend, press, color = (array[i].astype(np.float64) for array in self.arrays())
            yaw = half_turn(float(theta) + np.pi / 2) if tool.kind == "flat" else 0.0
            xyz_yaw = stroke_points(
                middle, float(theta), float(length), bend_m=float(bend), press_m=press, yaw_rad=yaw,
                points=points,
            )  # fmt: skip
            path = timed_path(xyz_yaw, tool.speed_m_s)
            planned.append(PlannedStroke(path, color_of(tool, color), dip=False))
        return planned

    def _places(self, points: int) -> tuple[Array, Array]:
        """Canvas coordinates along the paths, [S, N] each."""
        basis = _basis(points)
        along, across = self.length_m[:, None] * basis.along, self.bend_m[:, None] * basis.across
        cos, sin = np.cos(self.theta_rad)[:, None], np.sin(self.theta_rad)[:, None]
        return self.middle_m[:, :1] + cos * along - sin * across, self.middle_m[:, 1:] + sin * along + cos * across


def no_strokes() -> Strokes:
    """An empty set of Bézier strokes."""
    return Strokes(*(np.zeros((0, *rest), np.float32) for rest in ((2,), (), (), (), (3,), (3,))))


def with_color(strokes: Strokes, color_srgb: Array) -> Strokes:
    """The same strokes in other colours, sRGB [S, 3]."""
    return strokes.colored(srgb_to_linear(color_srgb))


class _Basis(NamedTuple):
    """Basis functions of the strokes' geometry at N points."""

    along: Array
    """[N], of a stroke of unit length."""
    across: Array
    """[N], of unit bend."""
    press: Array
    """[N, 3], of the press at start, middle and end."""


@cache
def _basis(points: int) -> _Basis:
    along, across = (function.astype(np.float32) for function in shape_basis(points))
    return _Basis(along, across, press_basis(points).astype(np.float32))
