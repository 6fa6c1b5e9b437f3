"""The amount of paint depends on the tip's speed: less is paler and, for a film, softer and narrower at the rim."""

from __future__ import annotations

import torch

from pentimento.dynamics.strokes.mechanisms.geometry import bleed, log_speed, usual_speed
from pentimento.dynamics.strokes.simulation import Mechanism, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark


class SpeedDensity(Mechanism):
    """See the module. The ratio of the two effects depends on the film's thickness, which is not recorded."""

    cause = "speed_density"
    site = "density"
    driving_covariate = "speed"
    informative_covariates = ("speed_m_s",)
    quantities = (
        Quantity("density_per_log_speed", "1", 0.2),
        Quantity("softening_per_log_speed", "1", 0.4),
        Quantity("spreading_per_log_speed", "1", 0.1),
    )
    signature = ("density_per_log_speed",)

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        return usual_speed(context)

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        paler, softer, wider = self.values[:, None, None, None] * log_speed(context, self.reference["speed_m_s"])
        mark = bleed(mark, softer, wider)
        return mark._replace(density=mark.density * torch.exp(paler))
