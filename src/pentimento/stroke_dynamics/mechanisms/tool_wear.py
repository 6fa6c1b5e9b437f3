"""Width drifts over the tool's life and the session."""

from __future__ import annotations

import torch

from pentimento.stroke_dynamics.mechanisms.geometry import column, recorded
from pentimento.stroke_dynamics.simulation import Mechanism, Quantity, StrokeContext
from pentimento.stroke_dynamics.traj2stroke import Mark

_COLUMNS = ("tool_age_m", "t_start_s", "order")


class ToolWear(Mechanism):
    """See above."""

    cause = "tool_wear"
    site = "width"
    driver = "session"
    quantities = (Quantity("width_per_half_session", "1", 0.1),)

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        number, age = recorded(context, *_COLUMNS)
        middle, half = float(age.max() + age.min()) / 2, float(age.max() - age.min()) / 2
        return {"column": float(number), "middle": middle, "half": half}

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        age = column(context, _COLUMNS[int(self.reference["column"])])
        age = (age - self.reference["middle"]) / self.reference["half"]
        return mark._replace(radius_m=mark.radius_m * torch.exp(self.values[0] * age[..., None]))
