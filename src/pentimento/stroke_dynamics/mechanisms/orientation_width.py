"""Width depends on the heading relative to the tool's yaw."""

from __future__ import annotations

import torch

from pentimento.stroke_dynamics.mechanisms.geometry import canvas_directions, tangent
from pentimento.stroke_dynamics.simulation import Mechanism, Quantity, StrokeContext
from pentimento.stroke_dynamics.traj2stroke import Mark


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
        return canvas_directions(context)

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        along = tangent(context.path)
        twice = 2 * (torch.atan2(along[..., 1], along[..., 0]) - context.path[..., 4])
        amount = self.values[0] * torch.cos(twice) + self.values[1] * torch.sin(twice)
        return mark._replace(radius_m=mark.radius_m * torch.exp(amount))
