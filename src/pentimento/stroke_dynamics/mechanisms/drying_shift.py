"""Darkness and colour drift over the session."""

from __future__ import annotations

import torch
from torch import Tensor

from pentimento.stroke_dynamics.mechanisms.geometry import column, recorded
from pentimento.stroke_dynamics.simulation import Mechanism, Quantity, StrokeContext
from pentimento.stroke_dynamics.traj2stroke import Mark

_COLUMNS = ("t_start_s", "order")


class DryingShift(Mechanism):
    """See above."""

    cause = "drying_shift"
    site = "density"
    driver = "session"
    quantities = (
        Quantity("density_per_half_session", "1", 0.15),
        Quantity("lightness_per_half_session", "1", 0.15),
    )

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        number, time = recorded(context, *_COLUMNS)
        return {
            "column": float(number),
            "middle": float(time.max() + time.min()) / 2,
            "half": float(time.max() - time.min()) / 2,
        }

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        return mark._replace(density=mark.density * torch.exp(self.values[0] * self._time(context)[..., None]))

    def composite(self, color: Tensor, pickup: Tensor | None, context: StrokeContext) -> tuple[Tensor, Tensor | None]:
        return color * torch.exp(self.values[1] * self._time(context)[..., None]), pickup

    def _time(self, context: StrokeContext) -> Tensor:
        return (column(context, _COLUMNS[int(self.reference["column"])]) - self.reference["middle"]) / self.reference[
            "half"
        ]
