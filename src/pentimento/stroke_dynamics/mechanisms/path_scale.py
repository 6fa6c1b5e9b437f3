"""The executed path is scaled about its start against the command (the thesis's m)."""

from __future__ import annotations

from pentimento.stroke_dynamics.simulation import Mechanism, Quantity, StrokeContext
from pentimento.stroke_dynamics.traj2stroke import Mark


class PathScale(Mechanism):
    """See above."""

    cause = "path_scale"
    site = "trajectory"
    driver = "motion"
    quantities = (
        Quantity("x", "1", 0.05),
        Quantity("y", "1", 0.05),
    )

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        start = context.path[..., :1, 1:3]
        return mark._replace(points_m=mark.points_m + self.values * (mark.points_m - start))
