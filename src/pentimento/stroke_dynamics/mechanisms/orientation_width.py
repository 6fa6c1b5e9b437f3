"""Width depends on the heading relative to the tool's yaw."""

from __future__ import annotations

import torch

from pentimento.stroke_dynamics.mechanisms.geometry import canvas_directions, tangent
from pentimento.stroke_dynamics.simulation import Mechanism, NotObservable, Quantity, StrokeContext
from pentimento.stroke_dynamics.traj2stroke import Mark

_ONE_HEADING = 0.02
"""Spread (1 - mean resultant length) of doubled headings below which all strokes run the same way."""


class OrientationWidth(Mechanism):
    """See above."""

    cause = "orientation_width"
    site = "width"
    driver = "heading"
    quantities = (
        Quantity("cos", "1", 0.2),
        Quantity("sin", "1", 0.2),
    )

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        # Where all strokes run alike, headings differ along bent ones alone, and stand for how far their ends are.
        if _spread_of_headings(context) < _ONE_HEADING:
            raise NotObservable("all strokes run the same way against the tool's yaw")
        return canvas_directions(context)

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        along = tangent(context.path)
        twice = 2 * (torch.atan2(along[..., 1], along[..., 0]) - context.path[..., 4])
        amount = self.values[0] * torch.cos(twice) + self.values[1] * torch.sin(twice)
        return mark._replace(radius_m=mark.radius_m * torch.exp(amount))


def _spread_of_headings(context: StrokeContext) -> float:
    """Of the way from start to end against the yaw, a half turn being none: 0 alike, 1 all over."""
    chords = (context.path[..., -1, 1:3] - context.path[..., 0, 1:3]).flatten(0, -2)
    twice = 2 * (torch.atan2(chords[:, 1], chords[:, 0]) - context.path[..., 0, 4].flatten())
    return 1 - float(torch.stack([torch.cos(twice).mean(), torch.sin(twice).mean()]).norm())
