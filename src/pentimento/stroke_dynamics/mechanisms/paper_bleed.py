"""Ink spreads beyond the contact patch, by how much the surface or the air drinks."""

from __future__ import annotations

from pentimento.stroke_dynamics.mechanisms.bleeding import bleed
from pentimento.stroke_dynamics.mechanisms.geometry import column, recorded
from pentimento.stroke_dynamics.simulation import Mechanism, Quantity, StrokeContext
from pentimento.stroke_dynamics.traj2stroke import Mark

_COLUMNS = ("surface_level", "humidity", "humidity_pct", "relative_humidity")


class PaperBleed(Mechanism):
    """See above."""

    cause = "paper_bleed"
    site = "density"
    driver = "paper"
    quantities = (
        Quantity("softening", "1", 0.4),
        Quantity("spreading", "1", 0.1),
    )

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        number, drinks = recorded(context, *_COLUMNS)
        return {"column": float(number), "middle": float(drinks.mean()), "spread": float(drinks.std())}

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        drinks = column(context, _COLUMNS[int(self.reference["column"])])[..., None]
        drinks = (drinks - self.reference["middle"]) / self.reference["spread"]
        return bleed(mark, self.values[0] * drinks, self.values[1] * drinks)
