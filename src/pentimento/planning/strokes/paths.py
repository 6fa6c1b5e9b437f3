"""The interface of strokes that can be planned: parameters → paths → marks, whatever the parameters are.

The planner moves the arrays of a ``PlannedPaths`` and knows nothing else about it. ``strokes.bezier.Strokes`` describes
a stroke by a Bézier curve, ``strokes.shapes.ShapedStrokes`` by the latent of a handwriting style or any other shape.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from copy import copy
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb
from pentimento.contracts.plan import PlannedStroke
from pentimento.robots.tools import Tool

if TYPE_CHECKING:
    from pentimento.planning.strokes.brush import Brush, Marks

Array = NDArray[np.float32]
Index = NDArray[np.integer[Any]] | NDArray[np.bool_] | slice


class PlannedPaths(ABC):
    """S strokes in SI units, canvas frame, float32. An optimiser changes their arrays in place."""

    row_arrays: ClassVar[tuple[str, ...]]
    """Names of the arrays that have one row for each stroke."""
    holds_covariates: ClassVar[bool]
    """Whether inherited covariates are computed once for a descent. Otherwise they are computed at each iteration."""
    is_fixed: ClassVar[bool] = False
    """The strokes are executed as they are: no planner moves, adds or removes one."""
    theta_rad: Array
    """[S] heading."""
    color: Array
    """[S, 3] linear light."""
    inherited: Mapping[str, Array] | None
    """[S] each: covariates that depend on the earlier strokes (``planning.strokes.memory``). None: not computed yet."""

    def __len__(self) -> int:
        return len(self.theta_rad)

    @abstractmethod
    def arrays(self) -> tuple[Array, ...]:
        """All arrays that an optimiser may move. The colour is the last."""

    def scales(self) -> tuple[Array | None, ...]:
        """For each of ``arrays`` the unit of its elements; see ``Adam``."""
        return (None,) * len(self.arrays())

    @abstractmethod
    def paths(self, points: int) -> Array:
        """Commanded paths [S, points, 5] (t_s, x_m, y_m, z_m, yaw_rad), with times and yaw 0."""

    @abstractmethod
    def marks(self, brush: Brush, inherited: Mapping[str, Array]) -> tuple[Marks, Callable[[Marks], tuple[Array, ...]]]:
        """What the strokes leave, and the pull-back: from ∂loss/∂marks to the gradient of each of ``arrays``."""

    @abstractmethod
    def keep_within(self, tool: Tool, canvas_size_m: tuple[float, float], edge_m: float) -> None:
        """Move each stroke, in place, to the nearest one that the tool can make inside the canvas."""

    @abstractmethod
    def planned(self, tool: Tool, points: int) -> list[PlannedStroke]:
        """The strokes as timed paths of ``points`` points that the robot executes at the tool's speed, in their own
        colours, or in the tool's ink. The executor adds the dips.
        """

    def colored(self, color: Array) -> Self:
        """The same strokes in other colours, linear light [S, 3]. The other arrays are shared."""
        return self._with({"color": color}, self.inherited)

    def pick(self, index: Index) -> Self:
        """A copy of some strokes, in the order of ``index``, with their inherited covariates."""
        kept = None if self.inherited is None else {name: values[index] for name, values in self.inherited.items()}
        return self._with({name: getattr(self, name)[index].copy() for name in self.row_arrays}, kept)

    def joined(self, others: Self) -> Self:
        """Copies of these strokes, then the others. Their inherited covariates are not computed yet."""
        rows = {name: np.concatenate([getattr(self, name), getattr(others, name)]) for name in self.row_arrays}
        return self._with(rows, None)

    def _with(self, rows: Mapping[str, Array], inherited: Mapping[str, Array] | None) -> Self:
        strokes = copy(self)
        for name, values in rows.items():
            setattr(strokes, name, values)
        strokes.inherited = inherited
        return strokes


def color_of(tool: Tool, linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """The colour of a stroke, sRGB [3]: its own, from linear light, or that of the tool's ink."""
    return np.clip(linear_to_srgb(linear), 0, 1) if tool.color_srgb is None else np.array(tool.color_srgb)


def half_turn(yaw_rad: float) -> float:
    """The equivalent yaw of a flat tool within a quarter turn of 0."""
    return float((yaw_rad + np.pi / 2) % np.pi - np.pi / 2)


def shift_within(places: tuple[Array, ...], middle_m: Array, canvas_size_m: tuple[float, float], edge_m: float) -> None:
    """Move ``middle_m`` [S, 2], in place, so that the boxes of the paths lie ``edge_m`` inside the canvas.

    Args:
        places: x and y of the paths' points, [S, N] each, canvas frame.
    """
    for axis, (place, size) in enumerate(zip(places, canvas_size_m, strict=True)):
        middle_m[:, axis] += np.maximum(edge_m - place.min(1), 0.0)
        middle_m[:, axis] -= np.maximum(place.max(1) - (size - edge_m), 0.0)
