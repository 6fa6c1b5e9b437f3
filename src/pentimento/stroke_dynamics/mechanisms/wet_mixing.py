"""Paint that is still wet below is picked up and carried along."""

from __future__ import annotations

import torch
from torch import Tensor

from pentimento.stroke_dynamics.mechanisms.geometry import column
from pentimento.stroke_dynamics.simulation import Mechanism, NotObservable, Quantity, StrokeContext


class WetMixing(Mechanism):
    """See above."""

    cause = "wet_mixing"
    site = "composite"
    driver = "paint below"
    quantities = (Quantity("pickup", "1", 0.3),)

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        age = context.covariates.get("wet_age_s")
        if age is None or not bool(torch.isfinite(age).any()):
            raise NotObservable("no stroke is known to cross paint (wet_age_s)")
        return {"drying_s": max(float(age[torch.isfinite(age)].median()), 1.0)}

    def composite(self, color: Tensor, pickup: Tensor | None, context: StrokeContext) -> tuple[Tensor, Tensor | None]:
        age = column(context, "wet_age_s")
        wet = torch.where(torch.isfinite(age), torch.exp(-age / self.reference["drying_s"]), 0.0)
        return color, self.values[0] * wet
