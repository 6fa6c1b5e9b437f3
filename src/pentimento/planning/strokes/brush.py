"""The planner's two seams: what strokes will look like, and how far a picture is from what is wanted.

Neither says how it is computed: the workshop's stroke models and objectives are PyTorch's, a robot's are exported
graphs. The planner asks both for values and for gradients, and all between them is its own. Arrays are float32.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pentimento.planning.strokes.bezier import Strokes

Array = NDArray[np.float32]


class Marks(NamedTuple):
    """What strokes leave, canvas frame, metres; or a cotangent of that: ∂loss/∂field, each of its field's shape."""

    points_m: Array
    """[S, N, 2]."""
    radius_m: Array
    """[S, N], half the width."""
    density: Array
    """[S, N], how much of the ground is covered on the path, 0 to 1."""
    softness: Array
    """[S, N], see ``render.kernel``."""
    color: Array
    """[S, 3], linear light."""
    pickup: Array | None
    """[S], the share of wet paint that is picked up on the way; None where tools stay clean."""


Pull = Callable[[Marks], Strokes]
"""From ∂loss/∂marks to ∂loss/∂strokes: what ``Brush.marks`` did, backwards. Gradients are strokes' six arrays."""


class Brush(Protocol):
    """A stroke model with what extends it, for one tool and one number of points in a path."""

    @property
    def fitted(self) -> Mapping[str, Span]:
        """Every column of the strokes contract that marks depend on; empty where strokes inherit nothing."""

    @property
    def timing(self) -> LoopTiming:
        """Of the robot that it was fitted on."""

    @property
    def path_points(self) -> int:
        """N: of each path, as it is commanded and as it is drawn."""

    def marks(self, strokes: Strokes, inherited: Mapping[str, Array]) -> tuple[Marks, Pull]:
        """What the strokes leave, and the way back for gradients.

        Args:
            strokes: S of them, any number from 1.
            inherited: [S] of each column in ``fitted``; no gradient goes there.
        """

    def gain(self, places_m: Array) -> Array | None:
        """[P, 3] by what a camera multiplies the light of places [P, 2] (canvas frame); None where it does not."""


class Span(NamedTuple):
    """Of a column of the strokes contract, over the strokes that a model was fitted to."""

    low: float
    mean: float
    high: float

    @property
    def ends(self) -> tuple[float, float]:
        """Both."""
        return self.low, self.high


class LoopTiming(NamedTuple):
    """How long the robot takes between two strokes, in seconds: the medians of what was recorded."""

    reach_s: float
    """From the end of waiting to the next stroke's start."""
    dip_s: float
    """More, where it dips."""
