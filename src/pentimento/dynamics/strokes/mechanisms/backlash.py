"""An offset against the motion along each axis, that turns over as the axis does.

It turns as a rod does that springs before it slides (Dahl 1976): by the way that the axis has gone, not at once.
"""

from __future__ import annotations

import torch

from pentimento.dynamics.strokes.mechanisms.geometry import SHAPE, canvas_directions
from pentimento.dynamics.strokes.simulation import Mechanism, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark

_MIN_WAY_M = 5e-5
"""By which an axis of hardly any play turns over."""
_FROM_THE_START = 0.5
"""Share of the offset."""


class Backlash(Mechanism):
    """See above. Which way an axis came before a stroke is not recorded: half of its offset is there from the start."""

    cause = "backlash"
    site = "trajectory"
    driving_covariate = "reversal"
    informative_covariates = SHAPE
    quantities = (
        Quantity("x_m", "m", 0.0005),
        Quantity("y_m", "m", 0.0005),
    )

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        return canvas_directions(context)

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        step = context.path[..., 1:3].diff(dim=-2)
        kept = torch.exp(-step.abs() / (self.values.abs() + _MIN_WAY_M))
        side = [_FROM_THE_START * torch.sign(step[..., 0, :])]
        for k in range(step.shape[-2]):
            side.append(side[-1] * kept[..., k, :] + torch.sign(step[..., k, :]) * (1 - kept[..., k, :]))
        return mark._replace(points_m=mark.points_m - self.values * torch.stack(side, dim=-2))
