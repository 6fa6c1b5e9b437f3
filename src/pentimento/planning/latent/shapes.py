"""The seam between what a stroke looks like and where it lies: numbers → a path in the stroke's own frame, and back.

A planner that asks only this moves Bézier curves and a hand's strokes alike.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pentimento.robots.strokes import shape_basis
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
