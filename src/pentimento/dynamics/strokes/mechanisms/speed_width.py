"""Width changes with the tip's speed."""

from __future__ import annotations

import torch

from pentimento.dynamics.strokes.mechanisms.geometry import log_speed, usual_speed
from pentimento.dynamics.strokes.simulation import Mechanism, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark


class SpeedWidth(Mechanism):
    cause = "speed_width"
    site = "width"
    driving_covariate = "speed"
    informative_covariates = ("speed_m_s",)
    quantities = (Quantity("width_per_log_speed", "1", 0.2),)

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        return usual_speed(context)

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        return mark._replace(
            radius_m=mark.radius_m * torch.exp(self.values[0] * log_speed(context, self.reference["speed_m_s"]))
        )
