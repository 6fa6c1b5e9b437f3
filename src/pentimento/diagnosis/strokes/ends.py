"""A mark whose two ends differ: what a tool leaves where it comes down and where it lifts off. Part of the base.

Where strokes are straight it looks like a lag. One that leaves nothing for these ends to do takes their place. Any
other cause that moves the path must explain more than they do; once it does, the search looks back and drops them if
nothing speaks for them any more.
"""

from __future__ import annotations

import torch

from pentimento.dynamics.strokes.mechanisms.geometry import arc_m, moved_ends
from pentimento.dynamics.strokes.simulation import Mechanism, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark


class UnevenEnds(Mechanism):
    """See above."""

    cause = "uneven_ends"
    site = "trajectory"
    driver = "motion"
    quantities = (
        Quantity("start_m", "m", 0.0005),
        Quantity("end_m", "m", 0.0005),
        Quantity("start_widening", "1", 0.1),
        Quantity("end_widening", "1", 0.1),
    )

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        start_m, end_m, start_widening, end_widening = self.values
        arc, reach = arc_m(context.path), mark.radius_m.mean(-1, keepdim=True)
        points, radius = moved_ends(mark.points_m, mark.radius_m, context.path, start_m, end_m)
        widening = start_widening * torch.exp(-arc / reach)
        widening = widening + end_widening * torch.exp(-(arc[..., -1:] - arc) / reach)
        return mark._replace(points_m=points, radius_m=radius * torch.exp(widening))
