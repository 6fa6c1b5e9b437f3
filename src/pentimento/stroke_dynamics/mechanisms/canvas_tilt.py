"""Press depth, and with it width, varies linearly over the canvas."""

from __future__ import annotations

from pentimento.stroke_dynamics.mechanisms.geometry import place, relative_place
from pentimento.stroke_dynamics.simulation import Mechanism, Quantity, StrokeContext
from pentimento.stroke_dynamics.traj2stroke import Mark


class CanvasTilt(Mechanism):
    """See above."""

    cause = "canvas_tilt"
    site = "width"
    driver = "place"
    quantities = (
        Quantity("x_m", "m of half-width at the edge", 0.0002),
        Quantity("y_m", "m of half-width at the edge", 0.0002),
    )

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        return place(context)

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        deeper = (relative_place(context.path[..., 1:3], self.reference) * self.values).sum(-1)
        return mark._replace(radius_m=(mark.radius_m + deeper).clamp(min=1e-5))
