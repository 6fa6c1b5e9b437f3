"""The executed path is shifted against the command (the thesis's b)."""

from __future__ import annotations

from pentimento.dynamics.strokes.mechanisms.geometry import canvas_directions
from pentimento.dynamics.strokes.simulation import Mechanism, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark


class PathOffset(Mechanism):
    cause = "path_offset"
    site = "trajectory"
    driving_covariate = "frame"
    quantities = (
        Quantity("x_m", "m", 0.0005),
        Quantity("y_m", "m", 0.0005),
    )

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        return canvas_directions(context)

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        return mark._replace(points_m=mark.points_m + self.values)
