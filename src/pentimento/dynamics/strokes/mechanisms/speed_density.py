"""Less paint is laid the faster the tip moves, or more: it is paler and, of a film, its rim softer and further in."""

from __future__ import annotations

import torch

from pentimento.dynamics.strokes.mechanisms.geometry import bleed, log_speed, usual_speed
from pentimento.dynamics.strokes.simulation import Mechanism, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark


class SpeedDensity(Mechanism):
    """See above. How much paler and how much narrower depends on how thick the paint lies, which is not recorded."""

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

    @property
    def coherent(self) -> bool:
        """What is paler for less paint is softer at the rim; sharper, it has rather bled less."""
        density, softening, _ = self.values
        return bool(density * softening <= 0)

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        return usual_speed(context)

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        paler, softer, wider = self.values[:, None, None, None] * log_speed(context, self.reference["speed_m_s"])
        mark = bleed(mark, softer, wider)
        return mark._replace(density=mark.density * torch.exp(paler))
