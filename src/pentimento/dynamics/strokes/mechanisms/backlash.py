"""An offset against the motion along each axis, which changes sign when the axis reverses.

It changes with the distance travelled since the reversal, as in the Dahl friction model (1976), not at once.
"""

from __future__ import annotations

import torch

from pentimento.dynamics.strokes.mechanisms.geometry import SHAPE, canvas_directions
from pentimento.dynamics.strokes.simulation import Mechanism, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark

_MIN_WAY_M = 5e-5
"""Min distance of the reversal, for an axis of hardly any play."""
_FROM_THE_START = 0.5
"""Share of the offset at a stroke's start."""


class Backlash(Mechanism):
    """See the module. The motion before a stroke is not recorded: half of the offset applies from the start."""

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
