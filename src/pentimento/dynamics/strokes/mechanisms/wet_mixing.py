"""Wet paint below a stroke is stirred in and picked up.

Of paint of the age t the share (p + q t / t0) / (1 + t / t0) mixes: p of the freshest, q of old paint, t0 being the
median age of the paint that strokes cross. The paint A that the tool has picked up since it was loaded
(``paint_pickup``) is the share 1 - exp(-k A) of the paint that it lays down, also on blank paper.
"""

from __future__ import annotations

import torch
from torch import Tensor

from pentimento.contracts.covariates import PICKUP_COLUMNS
from pentimento.dynamics.strokes.mechanisms.geometry import column
from pentimento.dynamics.strokes.simulation import Mechanism, NotObservable, Quantity, StrokeContext


class WetMixing(Mechanism):
    cause = "wet_mixing"
    site = "composite"
    driving_covariate = "paint below"
    informative_covariates = ("wet_age_s", PICKUP_COLUMNS[0])
    quantities = (
        Quantity("pickup_of_fresh", "1", 0.3),
        Quantity("pickup_of_old", "1", 0.3),
        Quantity("carried", "1", 0.3),
    )

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        age = context.covariates.get("wet_age_s")
        if age is None or not bool(torch.isfinite(age).any()):
            raise NotObservable("no stroke is known to cross paint (wet_age_s)")
        return {"usual_age_s": max(float(age[torch.isfinite(age)].median()), 1.0)}

    def composite(self, color: Tensor, pickup: Tensor | None, context: StrokeContext) -> tuple[Tensor, Tensor | None]:
        age = column(context, "wet_age_s") / self.reference["usual_age_s"]
        known = torch.nan_to_num(age, nan=0.0)
        share = (self.values[0] + self.values[1] * known) / (1 + known)
        stirred = torch.where(torch.isfinite(age), share, 0.0)
        amount, *picked_up = (column(context, name) for name in PICKUP_COLUMNS)
        laid = 1 - torch.exp(-self.values[2] * amount)
        return color + laid[..., None] * (torch.stack(picked_up, dim=-1) - color), stirred
