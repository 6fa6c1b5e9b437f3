"""Width drifts over the tool's life and the session."""

from __future__ import annotations

import torch

from pentimento.stroke_dynamics.mechanisms.geometry import column, recorded
from pentimento.stroke_dynamics.simulation import Mechanism, Quantity, StrokeContext
from pentimento.stroke_dynamics.traj2stroke import Mark


class ToolWear(Mechanism):
    """See above."""

    cause = "tool_wear"
    site = "width"
    driver = "session"
    quantities = (Quantity("width_per_half_session", "1", 0.1),)

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        age = recorded(context, "tool_age_m", "t_start_s", "order")
        middle, half = float(age.max() + age.min()) / 2, float(age.max() - age.min()) / 2
        return {"middle": middle, "half": half}

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        age = (column(context, "tool_age_m", "t_start_s", "order") - self.reference["middle"]) / self.reference["half"]
        return mark._replace(radius_m=mark.radius_m * torch.exp(self.values[0] * age[..., None]))
