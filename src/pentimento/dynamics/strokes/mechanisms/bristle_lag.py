"""The contact patch trails the tip by a distance along the path."""

from __future__ import annotations

import torch

from pentimento.dynamics.strokes.mechanisms.geometry import SHAPE, trailing
from pentimento.dynamics.strokes.simulation import Mechanism, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark


class BristleLag(Mechanism):
    cause = "bristle_lag"
    site = "trajectory"
    driving_covariate = "motion"
    informative_covariates = SHAPE
    quantities = (Quantity("distance_m", "m", 0.003, signed=False),)

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        distance = self.values[0] * torch.ones_like(context.path[..., :1, 0])
        return mark._replace(points_m=trailing(mark.points_m, distance))
