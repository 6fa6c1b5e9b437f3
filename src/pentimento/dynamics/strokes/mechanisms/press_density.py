"""The amount of paint depends on the press: a tool that is pressed harder is darker."""

from __future__ import annotations

import torch

from pentimento.dynamics.strokes.mechanisms.geometry import press_varies
from pentimento.dynamics.strokes.simulation import Mechanism, NotObservable, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark


class PressDensity(Mechanism):
    """See the module."""

    cause = "press_density"
    site = "density"
    driving_covariate = "press"
    informative_covariates = ("press_m",)
    quantities = (Quantity("density_per_half_range", "1", 0.2),)

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        """``press_m`` and ``half_press_m``: middle and half of the range of press depths."""
        if not press_varies(context):
            raise NotObservable("all strokes have the same press")
        press = -context.path[..., 3]
        low, high = float(press.min()), float(press.max())
        return {"press_m": (low + high) / 2, "half_press_m": (high - low) / 2}

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        press = (-context.path[..., 3] - self.reference["press_m"]) / self.reference["half_press_m"]
        return mark._replace(density=mark.density * torch.exp(self.values[0] * press))
