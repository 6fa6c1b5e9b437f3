"""Darkness and colour drift over the session, and while a stroke dries until its photograph.

With the session's time u in [-1, 1], and the dryness 1 - 2^(-age/half) minus its value at the usual age, for two
half-lives: *soon* has the usual age as half-life, *late* the oldest age,

    density' = density * exp(a u + b soon + c late),   colour' = colour * exp(d u + e soon + f late).

The drying time is not recorded. Most strokes are photographed at once and few late; the two functions span the ages in
between. A stroke with an unknown time of its photograph, such as a planned one, has the usual age.
"""

from __future__ import annotations

import torch
from torch import Tensor

from pentimento.dynamics.strokes.mechanisms.geometry import SESSION, column, recorded, varies
from pentimento.dynamics.strokes.simulation import Mechanism, NotObservable, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark

_COLUMNS = ("t_start_s", "order")
_SHORTEST_S = 0.1


class DryingShift(Mechanism):
    cause = "drying_shift"
    site = "density"
    driving_covariate = "session"
    informative_covariates = SESSION
    quantities = (
        Quantity("density_per_half_session", "1", 0.15),
        Quantity("lightness_per_half_session", "1", 0.15),
        Quantity("density_soon_dry", "1", 0.15),
        Quantity("lightness_soon_dry", "1", 0.15),
        Quantity("density_late_dry", "1", 0.15),
        Quantity("lightness_late_dry", "1", 0.15),
    )

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        age = _age_s(context)
        ages = bool(torch.isfinite(age).all()) and varies(torch.log(age))
        known = {"usual_age_s": float(torch.log(age).mean().exp()), "oldest_s": float(age.max())} if ages else {}
        try:
            number, time = recorded(context, *_COLUMNS)
        except NotObservable:
            if not ages:
                raise
            return known
        half = float(time.max() - time.min()) / 2
        return {"column": float(number), "middle": float(time.min()) + half, "half": half} | known

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        return mark._replace(density=mark.density * torch.exp(self._drift(context, self.values[0::2]))[..., None])

    def composite(self, color: Tensor, pickup: Tensor | None, context: StrokeContext) -> tuple[Tensor, Tensor | None]:
        return color * torch.exp(self._drift(context, self.values[1::2]))[..., None], pickup

    def _drift(self, context: StrokeContext, values: Tensor) -> Tensor:
        """[B, S], by values [3] of time, soon and late dryness."""
        drift = values[0] * self._time(context)
        if "usual_age_s" not in self.reference:
            return drift
        usual_s, oldest_s = self.reference["usual_age_s"], self.reference["oldest_s"]
        age_s = _age_s(context).nan_to_num(usual_s)
        usual = torch.full_like(age_s, usual_s)
        soon, late = (_dryness(age_s, half_s) - _dryness(usual, half_s) for half_s in (usual_s, oldest_s))
        return drift + values[1] * soon + values[2] * late

    def _time(self, context: StrokeContext) -> Tensor:
        if "column" not in self.reference:
            return torch.zeros_like(context.path[..., 0, 0])
        time = column(context, _COLUMNS[int(self.reference["column"])])
        return (time - self.reference["middle"]) / self.reference["half"]


def _dryness(age_s: Tensor, half_s: float) -> Tensor:
    """1 - 2^(-age/half), 0 to 1."""
    return 1 - torch.exp2(-age_s / half_s)


def _age_s(context: StrokeContext) -> Tensor:
    """From a stroke's end to its photograph, [B, S]; NaN where unknown, also for strokes of unknown duration."""
    known = context.covariates
    if "t_after_s" not in known or "t_start_s" not in known:
        return torch.full_like(context.path[..., 0, 0], torch.nan)
    duration = context.path[..., -1, 0] - context.path[..., 0, 0]
    return (known["t_after_s"] - known["t_start_s"] - duration).clamp(min=_SHORTEST_S)
