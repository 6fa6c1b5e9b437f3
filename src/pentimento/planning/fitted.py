"""Of what a stroke model was fitted to, what a plan has to know: between which values, and at which pace."""

from __future__ import annotations

from typing import NamedTuple


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
