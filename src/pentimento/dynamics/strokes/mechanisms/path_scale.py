"""The executed path is the command scaled about its start (the thesis's m).

Where headings on the canvas are unknown, only one factor for both axes is identifiable: ``x``.
"""

from __future__ import annotations

from pentimento.dynamics.strokes.mechanisms.geometry import SHAPE, headings_unknown
from pentimento.dynamics.strokes.simulation import Mechanism, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark


class PathScale(Mechanism):
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
        return {"one_factor": float(headings_unknown(context))}

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        factor = self.values[:1] if self.reference.get("one_factor") else self.values
        start = context.path[..., :1, 1:3]
        return mark._replace(points_m=mark.points_m + factor * (mark.points_m - start))
