"""Coverage and width fall with the length drawn since the last dip."""

from __future__ import annotations

import torch

from pentimento.dynamics.strokes.mechanisms.geometry import arc_m, column, recorded, varies
from pentimento.dynamics.strokes.simulation import Mechanism, NotObservable, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark

_COLUMNS = ("ink_since_reload_m", "since_reload")


class InkDepletion(Mechanism):
    cause = "ink_depletion"
    site = "density"
    driving_covariate = "load"
    informative_covariates = _COLUMNS
    quantities = (
        Quantity("density_loss", "1/reference length", 0.3),
        Quantity("width_loss", "1/reference length", 0.15),
    )

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        number, since = recorded(context, *_COLUMNS)
        age = context.covariates.get("tool_age_m")
        if age is not None and not varies(age - since) and varies(age):
            raise NotObservable("the tool is never reloaded, so that its ink is as old as itself (tool_wear)")
        return {"column": float(number), "since": float(since.mean())}

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        number = int(self.reference["column"])
        since = column(context, _COLUMNS[number])[..., None]
        if _COLUMNS[number] == "ink_since_reload_m":  # the other counts whole strokes
            since = since + arc_m(context.path)
        drawn = since / self.reference["since"]
        return mark._replace(
            density=mark.density * torch.exp(-self.values[0] * drawn),
            radius_m=mark.radius_m * torch.exp(-self.values[1] * drawn),
        )
