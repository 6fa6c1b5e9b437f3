"""Ink spreads beyond the contact patch, by how much the surface or the air drinks.

Surfaces are told apart, not ordered: each beyond the first has numbers of its own against the mean of all strokes, as
far as there are numbers. Of the air, what counts is the humidity, in standard deviations; it takes the first pair.
"""

from __future__ import annotations

import torch
from torch import Tensor

from pentimento.stroke_dynamics.mechanisms.bleeding import bleed
from pentimento.stroke_dynamics.mechanisms.geometry import column, recorded
from pentimento.stroke_dynamics.simulation import Mechanism, Quantity, StrokeContext
from pentimento.stroke_dynamics.traj2stroke import Mark

_COLUMNS = ("surface_level", "humidity", "humidity_pct", "relative_humidity")
_CONTRASTS = 5


class PaperBleed(Mechanism):
    """See above."""

    cause = "paper_bleed"
    site = "density"
    driver = "paper"
    quantities = (
        *(Quantity(f"softening_{k + 1}", "1", 0.4) for k in range(_CONTRASTS)),
        *(Quantity(f"spreading_{k + 1}", "1", 0.1) for k in range(_CONTRASTS)),
    )

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        number, drinks = recorded(context, *_COLUMNS)
        if _COLUMNS[number] != "surface_level":
            return {"column": float(number), "middle": float(drinks.mean()), "spread": float(drinks.std())}
        shares = {f"share_{k + 1}": float((drinks == k + 1).double().mean()) for k in range(_CONTRASTS)}
        return {"column": float(number)} | shares

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        contrasts = self._contrasts(context)
        softening, spreading = (contrasts @ part[:, None] for part in self.values.to(contrasts.dtype).chunk(2))
        return bleed(mark, softening, spreading)

    def _contrasts(self, context: StrokeContext) -> Tensor:
        """[B, S, contrasts]."""
        name = _COLUMNS[int(self.reference["column"])]
        drinks = column(context, name)[..., None]
        if name != "surface_level":
            first = (drinks - self.reference["middle"]) / self.reference["spread"]
            return torch.cat([first, torch.zeros_like(first).expand(*drinks.shape[:-1], _CONTRASTS - 1)], dim=-1)
        shares = torch.tensor([self.reference[f"share_{k + 1}"] for k in range(_CONTRASTS)], dtype=drinks.dtype)
        told_apart = (drinks == torch.arange(1, _CONTRASTS + 1)).to(drinks.dtype) - shares
        # A plan's sheet is none of those that were measured: it is as they are on average.
        return torch.where(drinks == drinks.round(), told_apart, 0.0)
