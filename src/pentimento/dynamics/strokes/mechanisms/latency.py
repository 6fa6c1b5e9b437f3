"""The tip lags its command by a constant time, and so by speed times time along the path."""

from __future__ import annotations

import torch

from pentimento.dynamics.strokes.mechanisms.geometry import SHAPE, arc_m, delayed, speed_m_s, usual_speed
from pentimento.dynamics.strokes.simulation import Mechanism, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark


class Latency(Mechanism):
    """See the module. The lag in space is small where the tip starts and stops."""

    cause = "latency"
    site = "trajectory"
    driving_covariate = "motion"
    informative_covariates = (*SHAPE, "speed_m_s")
    quantities = (Quantity("time_s", "s", 0.05, signed=False),)

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        return usual_speed(context)

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        speed = speed_m_s(context.path)[..., None]
        evenly = arc_m(context.path) / self.reference["speed_m_s"]
        times_s = torch.where(torch.isfinite(speed), context.path[..., 0], evenly)
        return mark._replace(points_m=delayed(mark.points_m, times_s, self.values[0]))
