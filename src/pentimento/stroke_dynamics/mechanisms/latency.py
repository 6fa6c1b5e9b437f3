"""The tip trails its command by a time, so by speed times time along the path."""

from __future__ import annotations

import torch

from pentimento.stroke_dynamics.mechanisms.geometry import SHAPE, speed_m_s, trailing, usual_speed
from pentimento.stroke_dynamics.simulation import Mechanism, Quantity, StrokeContext
from pentimento.stroke_dynamics.traj2stroke import Mark


class Latency(Mechanism):
    """A first-order servo: see above."""

    cause = "latency"
    site = "trajectory"
    driver = "motion"
    told_by = (*SHAPE, "speed_m_s")
    quantities = (Quantity("time_s", "s", 0.05, signed=False),)

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        return usual_speed(context)

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        speed = speed_m_s(context.path)
        late = self.values[0] * torch.where(torch.isfinite(speed), speed, self.reference["speed_m_s"])[..., None]
        return mark._replace(points_m=trailing(mark.points_m, late))
