"""The executed path is scaled about its start against the command (the thesis's m).

Of strokes of which it is not known how they are turned on the canvas, one factor for both axes can be told: ``x``.
"""

from __future__ import annotations

from pentimento.dynamics.strokes.mechanisms.geometry import SHAPE, turned_alike
from pentimento.dynamics.strokes.simulation import Mechanism, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark


class PathScale(Mechanism):
    """See above."""

    cause = "path_scale"
    site = "trajectory"
    driving_covariate = "extent"
    informative_covariates = SHAPE
    quantities = (
        Quantity("x", "1", 0.05),
        Quantity("y", "1", 0.05),
    )

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        return {"one_factor": float(turned_alike(context))}

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        factor = self.values[:1] if self.reference.get("one_factor") else self.values
        start = context.path[..., :1, 1:3]
        return mark._replace(points_m=mark.points_m + factor * (mark.points_m - start))
