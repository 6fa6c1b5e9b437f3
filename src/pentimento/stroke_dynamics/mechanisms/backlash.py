"""An offset that depends on the sign of motion along each axis."""

from __future__ import annotations

import torch

from pentimento.stroke_dynamics.mechanisms.geometry import SHAPE, canvas_directions, tangent
from pentimento.stroke_dynamics.simulation import Mechanism, Quantity, StrokeContext
from pentimento.stroke_dynamics.traj2stroke import Mark

_TURNING = 0.1
"""Share of the motion that lies along an axis below which its sign is not felt."""


class Backlash(Mechanism):
    """See above."""

    cause = "backlash"
    site = "trajectory"
    driver = "reversal"
    told_by = SHAPE
    quantities = (
        Quantity("x_m", "m", 0.0005),
        Quantity("y_m", "m", 0.0005),
    )

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        return canvas_directions(context)

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        side = torch.tanh(tangent(context.path) / _TURNING)
        return mark._replace(points_m=mark.points_m - self.values * side)
