"""Ink spreads beyond the contact patch, depending on the surface and the air's humidity.

Surfaces are categories: each after the first has its own contrasts against the mean of all strokes, up to a maximum
number of surfaces. Humidity enters in standard deviations.
"""

from __future__ import annotations

import torch
from torch import Tensor

from pentimento.dynamics.strokes.mechanisms.geometry import bleed, column, recorded
from pentimento.dynamics.strokes.simulation import Mechanism, NotObservable, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark

_AIR = ("humidity", "humidity_pct", "relative_humidity")
_CONTRASTS = 5


class PaperBleed(Mechanism):
    cause = "paper_bleed"
    site = "density"
    driving_covariate = "paper"
    informative_covariates = ("surface_level", *_AIR)
    quantities = (
        *(Quantity(f"softening_{k + 1}", "1", 0.4) for k in range(_CONTRASTS)),
        Quantity("softening_by_humidity", "1", 0.4),
        *(Quantity(f"spreading_{k + 1}", "1", 0.1) for k in range(_CONTRASTS)),
        Quantity("spreading_by_humidity", "1", 0.1),
    )

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        # Where surface or humidity is not recorded, it is taken to be the same for all strokes.
        shares, air, reasons = {}, {}, []
        try:
            _, surface = recorded(context, "surface_level")
            shares = {f"share_{k + 1}": float((surface == k + 1).double().mean()) for k in range(_CONTRASTS)}
        except NotObservable as reason:
            reasons.append(reason)
        try:
            number, humidity = recorded(context, *_AIR)
            air = {"air": float(number), "middle": float(humidity.mean()), "spread": float(humidity.std())}
        except NotObservable as reason:
            reasons.append(reason)
        if not shares and not air:
            raise reasons[0]
        return shares | air

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        contrasts = torch.cat([self._surfaces(context), self._air(context)], dim=-1)
        softening, spreading = (contrasts @ part[:, None] for part in self.values.to(contrasts.dtype).chunk(2))
        return bleed(mark, softening, spreading)

    def _surfaces(self, context: StrokeContext) -> Tensor:
        """[B, S, contrasts]."""
        if "share_1" not in self.reference:
            return context.path.new_zeros(*context.path.shape[:2], _CONTRASTS)
        surface = column(context, "surface_level")[..., None]
        shares = torch.tensor([self.reference[f"share_{k + 1}"] for k in range(_CONTRASTS)], dtype=surface.dtype)
        contrasts = (surface == torch.arange(1, _CONTRASTS + 1)).to(surface.dtype) - shares
        # A planned stroke's sheet is none of the measured ones: it has their mean.
        return torch.where(surface == surface.round(), contrasts, 0.0)

    def _air(self, context: StrokeContext) -> Tensor:
        """[B, S, 1]."""
        if "air" not in self.reference:
            return context.path.new_zeros(*context.path.shape[:2], 1)
        humidity = column(context, _AIR[int(self.reference["air"])])[..., None]
        return (humidity - self.reference["middle"]) / self.reference["spread"]
