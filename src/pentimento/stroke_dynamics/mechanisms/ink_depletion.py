"""Coverage and width fall with the length drawn since the last dip."""

from __future__ import annotations

import torch

from pentimento.stroke_dynamics.mechanisms.geometry import arc_m, column, recorded
from pentimento.stroke_dynamics.simulation import Mechanism, Quantity, StrokeContext
from pentimento.stroke_dynamics.traj2stroke import Mark


class InkDepletion(Mechanism):
    """See above."""

    cause = "ink_depletion"
    site = "density"
    driver = "load"
    quantities = (
        Quantity("density_loss", "1/reference length", 0.3),
        Quantity("width_loss", "1/reference length", 0.15),
    )

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        since = recorded(context, "ink_since_reload_m", "since_reload")
        own = 0.0 if since is context.covariates.get("since_reload") else 1.0  # strokes are counted whole
        return {"since": float(since.mean()), "own": own}

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        since = column(context, "ink_since_reload_m" if self.reference["own"] else "since_reload")[
            ..., None
        ] + self.reference["own"] * arc_m(context.path)
        drawn = since / self.reference["since"]
        return mark._replace(
            density=mark.density * torch.exp(-self.values[0] * drawn),
            radius_m=mark.radius_m * torch.exp(-self.values[1] * drawn),
        )
