"""Darkness and colour drift over the session, and as a stroke dries until it is seen.

With the session's time at u in [-1, 1], and d in [0, 1] the dryness that paint of a usual age is halfway to,

    density' = density * exp(a u + b (d - 1/2)),   colour' = colour * exp(c u + e (d - 1/2)).

Where it is not known when a stroke will be seen, as of one that is only planned, it is taken to be of the usual age.
"""

from __future__ import annotations

import torch
from torch import Tensor

from pentimento.stroke_dynamics.mechanisms.geometry import column, recorded, varies
from pentimento.stroke_dynamics.simulation import Mechanism, NotObservable, Quantity, StrokeContext
from pentimento.stroke_dynamics.traj2stroke import Mark

_COLUMNS = ("t_start_s", "order")
_SHORTEST_S = 0.1


class DryingShift(Mechanism):
    """See above."""

    cause = "drying_shift"
    site = "density"
    driver = "session"
    quantities = (
        Quantity("density_per_half_session", "1", 0.15),
        Quantity("lightness_per_half_session", "1", 0.15),
        Quantity("density_when_dry", "1", 0.15),
        Quantity("lightness_when_dry", "1", 0.15),
    )

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        age = _age_s(context)
        ages = bool(torch.isfinite(age).all()) and varies(torch.log(age))
        usual_age = {"usual_age_s": float(torch.log(age).mean().exp())} if ages else {}
        try:
            number, time = recorded(context, *_COLUMNS)
        except NotObservable:
            if not ages:
                raise
            return usual_age
        half = float(time.max() - time.min()) / 2
        return {"column": float(number), "middle": float(time.min()) + half, "half": half} | usual_age

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        drift = self.values[0] * self._time(context) + self.values[2] * self._dryness(context)
        return mark._replace(density=mark.density * torch.exp(drift[..., None]))

    def composite(self, color: Tensor, pickup: Tensor | None, context: StrokeContext) -> tuple[Tensor, Tensor | None]:
        drift = self.values[1] * self._time(context) + self.values[3] * self._dryness(context)
        return color * torch.exp(drift[..., None]), pickup

    def _time(self, context: StrokeContext) -> Tensor:
        if "column" not in self.reference:
            return torch.zeros_like(context.path[..., 0, 0])
        time = column(context, _COLUMNS[int(self.reference["column"])])
        return (time - self.reference["middle"]) / self.reference["half"]

    def _dryness(self, context: StrokeContext) -> Tensor:
        """Less the half that paint of the usual age has."""
        age = _age_s(context)
        if "usual_age_s" not in self.reference:
            return torch.zeros_like(age)
        dryness = 1 - torch.exp2(-age / self.reference["usual_age_s"]) - 0.5
        return torch.where(torch.isfinite(dryness), dryness, 0.0)


def _age_s(context: StrokeContext) -> Tensor:
    """From the end of each stroke until it was seen, [B, S]; NaN where unknown."""
    known = context.covariates
    if "t_after_s" not in known or "t_start_s" not in known:
        return torch.full_like(context.path[..., 0, 0], torch.nan)
    duration = torch.nan_to_num(context.path[..., -1, 0] - context.path[..., 0, 0])
    return (known["t_after_s"] - known["t_start_s"] - duration).clamp(min=_SHORTEST_S)
