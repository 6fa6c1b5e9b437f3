"""A tool's tip spreads, or wears off, over its life and the session: linearly, or faster at first."""

from __future__ import annotations

from pentimento.dynamics.strokes.mechanisms.geometry import SESSION, bleed, column, recorded
from pentimento.dynamics.strokes.simulation import Mechanism, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark

_COLUMNS = ("tool_age_m", "t_start_s", "order")


class ToolWear(Mechanism):
    """See the module. A spread tip's rim is softer."""

    cause = "tool_wear"
    site = "width"
    driving_covariate = "session"
    informative_covariates = SESSION
    quantities = (
        Quantity("width_per_half_session", "1", 0.1),
        Quantity("ahead_at_half_session", "1", 0.05),
        Quantity("softening_per_half_session", "1", 0.4),
    )

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        number, age = recorded(context, *_COLUMNS)
        middle, half = float(age.max() + age.min()) / 2, float(age.max() - age.min()) / 2
        return {"column": float(number), "middle": middle, "half": half}

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        age = column(context, _COLUMNS[int(self.reference["column"])])[..., None]
        age = (age - self.reference["middle"]) / self.reference["half"]
        width, ahead, softening = self.values
        return bleed(mark, softening * age, width * age + ahead * (1 - age**2))
