"""Width changes where the path bends."""

from __future__ import annotations

import torch

from pentimento.dynamics.strokes.mechanisms.geometry import SHAPE, bending_per_m
from pentimento.dynamics.strokes.simulation import Mechanism, NotObservable, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark


class CurvatureWidth(Mechanism):
    cause = "curvature_width"
    site = "width"
    driving_covariate = "bend"
    informative_covariates = SHAPE
    quantities = (Quantity("width_per_bend", "1", 0.2),)

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        bending = bending_per_m(context.path).abs()
        if float(bending.max()) < 1.0:
            raise NotObservable("all strokes are straight")
        return {"bending_per_m": float(bending.mean() + 2 * bending.std())}

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        bend = (bending_per_m(context.path).abs() / self.reference["bending_per_m"]).clamp(max=2.0)
        return mark._replace(radius_m=mark.radius_m * torch.exp(self.values[0] * bend))
