"""Strokes of any shape (thesis 5.3.5): shape parameters → a path in the stroke's own frame, and a pose on the canvas.

``Shapes`` is what the planner needs of a kind of shape. A handwriting style is one (``strokes.latent.StyleDecoder``),
the Bézier curve another, so that both can be compared with the same planner.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError
from pentimento.contracts.plan import PlannedStroke
from pentimento.planning.strokes.brush import Brush, Marks, PathBrush
from pentimento.planning.strokes.memory import add_times_and_yaw
from pentimento.planning.strokes.paths import PlannedPaths, color_of, half_turn, shift_within
from pentimento.robots.motion import timed_path
from pentimento.robots.strokes import press_basis, shape_basis
from pentimento.robots.tools import Tool

Array = NDArray[np.float32]

ShapePull = Callable[[Array], Array]
"""From ∂loss/∂paths [S, N, 2] to ∂loss/∂parameters [S, P]."""
PathPull = Callable[[Array], tuple[Array, ...]]
"""From ∂loss/∂paths [S, N, 5] to the gradient of each of ``ShapedStrokes.arrays`` but the colour."""

_MIN_STEP_M = 1e-6
"""Points of a path nearer than this are merged: the robot's clock cannot tell them apart."""


class Shapes(Protocol):
    """A kind of shape with P parameters."""

    @property
    def points(self) -> int:
        """N, of each path."""

    @property
    def spread(self) -> Array:
        """[P] standard deviation of each parameter over ``sample``: the unit of optimiser steps and of bounds."""

    def sample(self, count: int, rng: np.random.Generator) -> Array:
        """[count, P] parameters of random shapes."""

    def paths(self, parameters: Array) -> tuple[Array, ShapePull]:
        """Paths [S, N, 2] in metres about their own middle, heading along +x from first to last point, and the
        pull-back.
        """

    def constrain(self, parameters: Array, start: Array, reach: float) -> None:
        """Move each shape, in place, to the nearest allowed one, at most ``reach`` spreads from ``start`` [S, P]."""


class BezierShapes:
    """The Bézier strokes of thesis 4.3.1. P = 2: length and bend, in metres."""

    def __init__(self, tool: Tool, points: int) -> None:
        """Allow the lengths and bends of the tool."""
        self.points = points
        self._length, self._bend = tool.stroke_length_m, tool.bend_range
        self._along, self._across = (basis.astype(np.float32) for basis in shape_basis(points))
        uniform = 1 / np.sqrt(12)  # standard deviation of a uniform distribution of width 1
        middle = sum(self._length) / 2
        width = self._length[1] - self._length[0], (self._bend[1] - self._bend[0]) * middle
        self.spread = np.array(width, np.float32) * np.float32(uniform)

    def sample(self, count: int, rng: np.random.Generator) -> Array:
        """Uniform over the tool's lengths and bends."""
        length = rng.uniform(*self._length, count)
        return np.column_stack([length, length * rng.uniform(*self._bend, count)]).astype(np.float32)

    def paths(self, parameters: Array) -> tuple[Array, ShapePull]:
        """See ``Shapes``."""
        across = self._across - self._across.mean()
        path = np.stack([parameters[:, :1] * self._along, parameters[:, 1:] * across], axis=-1)

        def pull(of_path: Array) -> Array:
            return np.stack([of_path[..., 0] @ self._along, of_path[..., 1] @ across], axis=-1)

        return path, pull

    def constrain(self, parameters: Array, start: Array, reach: float) -> None:
        """Clip to the tool's range; ``start`` and ``reach`` have no effect."""
        np.clip(parameters[:, 0], *self._length, out=parameters[:, 0])
        low, high = (np.float32(bound) * parameters[:, 0] for bound in self._bend)
        np.clip(parameters[:, 1], low, high, out=parameters[:, 1])


@dataclass(eq=False)
class ShapedStrokes(PlannedPaths):
    """S strokes of one kind of shape: shape parameters, pose and press depths."""

    row_arrays: ClassVar[tuple[str, ...]] = ("parameters", "start", "middle_m", "theta_rad", "press_m", "color")
    holds_covariates: ClassVar[bool] = False

    shapes: Shapes
    reach: float
    """Each shape stays within so many spreads of its start; see ``Shapes.constrain``."""
    parameters: Array  # [S, P] of the shapes
    start: Array  # [S, P] parameters before any optimisation
    middle_m: Array  # [S, 2] mean of the path's points
    theta_rad: Array  # [S]
    press_m: Array  # [S, 3] at start, middle, end
    color: Array  # [S, 3] linear light
    inherited: Mapping[str, Array] | None = field(default=None, kw_only=True)

    def arrays(self) -> tuple[Array, ...]:
        """Shape parameters, middles, headings, presses and colours."""
        return (self.parameters, self.middle_m, self.theta_rad, self.press_m, self.color)

    def scales(self) -> tuple[Array | None, ...]:
        """Shape parameters move in units of their spread."""
        return (self.shapes.spread, None, None, None, None)

    def paths(self, points: int) -> Array:
        """See ``PlannedPaths``.

        Raises:
            ValueError: the shapes have another number of points.
        """
        if points != self.shapes.points:
            raise ValueError(f"Paths of {points} points are asked for; these shapes have {self.shapes.points}.")
        return self.placed()[0]

    def placed(self) -> tuple[Array, PathPull]:
        """Commanded paths [S, N, 5], with times and yaw 0, and the pull-back of gradients of x, y and z."""
        own, pull_shape = self.shapes.paths(self.parameters)
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

    def marks(self, brush: Brush, inherited: Mapping[str, Array]) -> tuple[Marks, Callable[[Marks], tuple[Array, ...]]]:
        """See ``PlannedPaths``.

        Raises:
            ConfigError: the brush takes Bézier strokes only.
        """
        if not isinstance(brush, PathBrush):
            raise ConfigError("Strokes of any shape need a brush with path_marks; this one takes Bézier strokes only.")
        path, pull_path = self.placed()
        marks, pull = brush.path_marks(add_times_and_yaw(path, self.theta_rad, brush.tool), self.color, inherited)

        def pull_all(of_marks: Marks) -> tuple[Array, ...]:
            of_path, of_color = pull(of_marks)
            return (*pull_path(of_path), of_color)

        return marks, pull_all

    def planned(self, tool: Tool, points: int) -> list[PlannedStroke]:
        """See ``PlannedPaths``.

        Raises:
            ValueError: the shapes have another number of points.
        """
        commanded = add_times_and_yaw(self.paths(points), self.theta_rad, tool).astype(np.float64)
        planned = []
        for path, color in zip(commanded, self.color.astype(np.float64), strict=True):
            path[:, 4] = half_turn(float(path[0, 4]))
            apart = np.append(True, np.linalg.norm(np.diff(path[:, 1:4], axis=0), axis=1) > _MIN_STEP_M)
            planned.append(PlannedStroke(timed_path(path[apart, 1:], tool.speed_m_s), color_of(tool, color), dip=False))
        return planned

    def keep_within(self, tool: Tool, canvas_size_m: tuple[float, float], edge_m: float) -> None:
        """See ``PlannedPaths``. The shapes are constrained, too."""
        self.shapes.constrain(self.parameters, self.start, self.reach)
        np.clip(self.press_m, *tool.press_range_m, out=self.press_m)
        np.clip(self.color, 0.0, 1.0, out=self.color)
        path = self.placed()[0]
        shift_within((path[..., 1], path[..., 2]), self.middle_m, canvas_size_m, edge_m)
