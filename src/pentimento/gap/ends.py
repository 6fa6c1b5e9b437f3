"""A mark whose two ends differ: what a tool leaves where it comes down and where it lifts off. Part of the base.

Where strokes are straight it looks like a lag. A cause that moves the path must explain more than that; once it does,
the search looks back and drops these ends if nothing speaks for them any more.
"""

from __future__ import annotations

import torch

from pentimento.stroke_dynamics.mechanisms.geometry import arc_m, tangent
from pentimento.stroke_dynamics.simulation import Mechanism, Quantity, StrokeContext
from pentimento.stroke_dynamics.traj2stroke import Mark


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
        along, arc = tangent(context.path), arc_m(context.path)
        points = mark.points_m.clone()
        points[..., 0, :] -= start_m * along[..., 0, :]
        points[..., -1, :] += end_m * along[..., -1, :]
        reach = mark.radius_m.mean()
        widening = start_widening * torch.exp(-arc / reach)
        widening = widening + end_widening * torch.exp(-(arc[..., -1:] - arc) / reach)
        return mark._replace(points_m=points, radius_m=mark.radius_m * torch.exp(widening))
