"""The seam between what a stroke looks like and where it lies: numbers → a path in the stroke's own frame, and back.

A planner that asks only this moves Bézier curves and a hand's strokes alike.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.plan import PlannedStroke
from pentimento.planning.strokes.bezier import Index
from pentimento.robots.motion import timed_path
from pentimento.robots.strokes import press_basis, shape_basis
from pentimento.robots.tools import Tool

Array = NDArray[np.float32]

ShapePull = Callable[[Array], Array]
"""From ∂loss/∂paths [S, N, 2] to ∂loss/∂numbers [S, P]."""


class Shapes(Protocol):
    """All the shapes that strokes can have."""

    @property
    def points(self) -> int:
        """N, of each path."""

    @property
    def spread(self) -> Array:
        """[P] the standard deviation of each number over what ``some`` gives: the scale of steps and of bounds."""

    def some(self, count: int, rng: np.random.Generator) -> Array:
        """[count, P] shapes as they are drawn."""

    def paths(self, numbers: Array) -> tuple[Array, ShapePull]:
        """Paths [S, N, 2] in metres about their own middle, heading along +x from first to last point; and the way
        back for gradients.
        """

    def hold(self, numbers: Array, home: Array, reach: float) -> None:
        """Move each shape, in place, to the nearest one that may be drawn, at most ``reach`` spreads from its home."""


class BezierShapes:
    """The strokes of thesis 4.3.1; P = 2: length and bend."""

    def __init__(self, tool: Tool, points: int) -> None:
        """The lengths and bends that the tool can make."""
        self.points = points
        self._length, self._bend = tool.stroke_length_m, tool.bend_range
        self._along, self._across = (basis.astype(np.float32) for basis in shape_basis(points))
        even = 1 / np.sqrt(12)
        middle = sum(self._length) / 2
        width = self._length[1] - self._length[0], (self._bend[1] - self._bend[0]) * middle
        self.spread = np.array(width, np.float32) * np.float32(even)

    def some(self, count: int, rng: np.random.Generator) -> Array:
        """Uniform over the tool's lengths and bends."""
        length = rng.uniform(*self._length, count)
        return np.column_stack([length, length * rng.uniform(*self._bend, count)]).astype(np.float32)

    def paths(self, numbers: Array) -> tuple[Array, ShapePull]:
        """See ``Shapes``."""
        across = self._across - self._across.mean()
        path = np.stack([numbers[:, :1] * self._along, numbers[:, 1:] * across], axis=-1)

        def pull(of_path: Array) -> Array:
            return np.stack([of_path[..., 0] @ self._along, of_path[..., 1] @ across], axis=-1)

        return path, pull

    def hold(self, numbers: Array, home: Array, reach: float) -> None:
        """Within the tool's range, wherever it began: a curve has no hand to keep to."""
        np.clip(numbers[:, 0], *self._length, out=numbers[:, 0])
        low, high = (np.float32(bound) * numbers[:, 0] for bound in self._bend)
        np.clip(numbers[:, 1], low, high, out=numbers[:, 1])


PathPull = Callable[[Array], tuple[Array, ...]]
"""From ∂loss/∂paths [S, N, 5] to the gradient of each of ``ShapedStrokes.arrays``."""

_APART_M = 1e-6
"""Points of a path nearer than this are one."""


@dataclass(eq=False)
class ShapedStrokes:
    """S strokes in SI units, canvas frame, float32: shape, pose and heights (thesis 5.3.5). Moved in place."""

    shapes: Shapes
    numbers: Array  # [S, P] of the shapes
    home: Array  # [S, P] where they began
    middle_m: Array  # [S, 2] mean of the path's points
    theta_rad: Array  # [S]
    press_m: Array  # [S, 3] at start, middle, end
    color: Array  # [S, 3] linear light

    def __len__(self) -> int:
        return len(self.theta_rad)

    def arrays(self) -> tuple[Array, ...]:
        """What is moved: numbers, middles, headings, presses."""
        return (self.numbers, self.middle_m, self.theta_rad, self.press_m)

    def pick(self, index: Index) -> ShapedStrokes:
        """A copy of some strokes, in the order of ``index``."""
        fields = (self.numbers, self.home, self.middle_m, self.theta_rad, self.press_m, self.color)
        return ShapedStrokes(self.shapes, *(array[index].copy() for array in fields))

    def joined(self, others: ShapedStrokes) -> ShapedStrokes:
        """These strokes, then the others, which are of the same shapes; copies."""
        names = ("numbers", "home", "middle_m", "theta_rad", "press_m", "color")
        pairs = (np.concatenate([getattr(self, name), getattr(others, name)]) for name in names)
        return ShapedStrokes(self.shapes, *pairs)

    def paths(self, points: int) -> Array:
        """Commanded paths [S, N, 5]; times and yaw are 0.

        Raises:
            ValueError: the shapes have another number of points.
        """
        if points != self.shapes.points:
            raise ValueError(f"Paths of {points} points are asked for; these shapes have {self.shapes.points}.")
        return self.placed()[0]

    def placed(self) -> tuple[Array, PathPull]:
        """Commanded paths [S, N, 5], times and yaw 0, and the way back for gradients of x, y and z."""
        own, pull_shape = self.shapes.paths(self.numbers)
        basis = press_basis(self.shapes.points).astype(np.float32)
        cos, sin = np.cos(self.theta_rad)[:, None], np.sin(self.theta_rad)[:, None]
        x, y = cos * own[..., 0] - sin * own[..., 1], sin * own[..., 0] + cos * own[..., 1]
        path = np.zeros((*own.shape[:2], 5), np.float32)
        path[..., 1], path[..., 2] = self.middle_m[:, :1] + x, self.middle_m[:, 1:] + y
        path[..., 3] = -self.press_m @ basis.T

        def pull(of_path: Array) -> tuple[Array, ...]:
            of_x, of_y = of_path[..., 1], of_path[..., 2]
            of_own = np.stack([cos * of_x + sin * of_y, cos * of_y - sin * of_x], axis=-1, dtype=np.float32)
            return (
                pull_shape(of_own),
                np.stack([of_x.sum(1), of_y.sum(1)], axis=-1),
                (of_y * x - of_x * y).sum(1),
                -np.asarray(of_path[..., 3] @ basis, dtype=np.float32),
            )

        return path, pull

    def keep_within(self, tool: Tool, canvas_size_m: tuple[float, float], edge_m: float, reach: float) -> None:
        """Move each stroke, in place, to the nearest one that hand and tool can make inside the canvas."""
        self.shapes.hold(self.numbers, self.home, reach)
        np.clip(self.press_m, *tool.press_range_m, out=self.press_m)
        path = self.placed()[0]
        for axis, size in enumerate(canvas_size_m):
            place = path[..., 1 + axis]
            self.middle_m[:, axis] += np.maximum(edge_m - place.min(1), 0.0)
            self.middle_m[:, axis] -= np.maximum(place.max(1) - (size - edge_m), 0.0)


def planned_strokes(strokes: ShapedStrokes, tool: Tool) -> list[PlannedStroke]:
    """The strokes as timed paths that the robot can execute at the tool's speed, in the tool's own ink."""
    planned = []
    for path in strokes.placed()[0].astype(np.float64):
        apart = np.append(True, np.linalg.norm(np.diff(path[:, 1:4], axis=0), axis=1) > _APART_M)
        timed = timed_path(path[apart, 1:], tool.speed_m_s)
        planned.append(PlannedStroke(timed, np.array(tool.color_srgb), dip=False))
    return planned
