"""Ink spreads depending on the tip's speed: the edge is softer or harder and, for a thick film, further out."""

from __future__ import annotations

from pentimento.dynamics.strokes.mechanisms.geometry import bleed, log_speed, usual_speed
from pentimento.dynamics.strokes.simulation import Mechanism, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark


class SpeedBleed(Mechanism):
    cause = "speed_bleed"
    site = "density"
    driving_covariate = "speed"
    informative_covariates = ("speed_m_s",)
    quantities = (Quantity("softening_per_log_speed", "1", 0.4), Quantity("spreading_per_log_speed", "1", 0.1))
    signature = ("softening_per_log_speed",)

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        return usual_speed(context)

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        faster = log_speed(context, self.reference["speed_m_s"])
        return bleed(mark, self.values[0] * faster, self.values[1] * faster)
