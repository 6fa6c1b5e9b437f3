"""The interface between the planner and a stroke model: what strokes leave on the canvas, with gradients.

A brush is a stroke model with its mechanisms, in PyTorch (workshop) or as exported graphs (robot). The planner asks it
for values and for gradients. Arrays are float32.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from pentimento.planning.strokes.bezier import Strokes
from pentimento.robots.refill import Depletion
from pentimento.robots.tools import Tool

Array = NDArray[np.float32]


@dataclass(frozen=True)
class Span:
    """Range and mean of a column of the strokes contract over the strokes that a model was fitted to."""

    low: float
    mean: float
    high: float

    @property
    def ends(self) -> tuple[float, float]:
        """Low and high."""
        return self.low, self.high


@dataclass(frozen=True)
class StrokeTiming:
    """How long the robot takes between two strokes: medians over the recorded strokes, in seconds."""

    reach_s: float
    """From the end of waiting to the start of the next stroke."""
    dip_s: float
    """Additional time where it dips."""


class Marks(NamedTuple):
    """What strokes leave, canvas frame, metres. Also a cotangent of that: ∂loss/∂field, each of its field's shape."""

    points_m: Array
    """[S, N, 2]."""
    radius_m: Array
    """[S, N], half the width."""
    density: Array
    """[S, N], the share of the ground that is covered at the centre of the path, 0 to 1."""
    softness: Array
    """[S, N], see ``render.kernel``."""
    color: Array
    """[S, 3], linear light."""
    pickup: Array | None
    """[S], the share of wet paint that a stroke picks up on its way. None: tools stay clean."""


Pull = Callable[[Marks], Strokes]
"""The pull-back of ``BezierBrush.marks``: from ∂loss/∂marks to ∂loss/∂strokes, which are the strokes' six arrays."""


class Brush(Protocol):
    """A stroke model with its mechanisms, for one tool and one number of points in a path.

    What strokes leave, ``BezierBrush`` and ``PathBrush`` say.
    """

    @property
    def fitted(self) -> Mapping[str, Span]:
        """Every column of the strokes contract that the marks depend on. Empty where there is none."""

    @property
    def timing(self) -> StrokeTiming:
        """Timing of the robot whose strokes the model was fitted to."""

    @property
    def depletion(self) -> Depletion | None:
        """How the tool's load runs out. None where the diagnosis did not establish that it does."""

    @property
    def path_points(self) -> int:
        """N, the number of points of each commanded and of each drawn path."""

    def gain(self, places_m: Array) -> Array | None:
        """[P, 3] factor of the camera on the light of places [P, 2] (canvas frame). None: no camera mechanism."""


@runtime_checkable
class BezierBrush(Brush, Protocol):
    """A brush that takes Bézier strokes."""

    def marks(self, strokes: Strokes, inherited: Mapping[str, Array]) -> tuple[Marks, Pull]:
        """What Bézier strokes leave, and the pull-back.

        Args:
            strokes: S of them, 1 or more.
            inherited: [S] of each column in ``fitted``. No gradient flows there.
        """


@runtime_checkable
class PathBrush(Brush, Protocol):
    """A brush that takes paths of any shape."""

    @property
    def tool(self) -> Tool:
        """The tool that the model was fitted to."""

    def path_marks(
        self, paths: Array, color: Array, inherited: Mapping[str, Array]
    ) -> tuple[Marks, Callable[[Marks], tuple[Array, Array]]]:
        """What commanded paths [S, N, 5] in colours [S, 3] leave, and the pull-back to ∂loss/∂paths [S, N, 5] and
        ∂loss/∂colours [S, 3]; ``inherited`` as for Bézier strokes.
        """
