"""Press depth varies linearly over the canvas, and with it the effects of press on the mark."""

from __future__ import annotations

import torch
from torch import Tensor

from pentimento.dynamics.strokes.mechanisms.geometry import place, press_varies, relative_place
from pentimento.dynamics.strokes.simulation import Mechanism, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark

_WIDTH_PER_PRESS = 0.5
"""Half-width for each metre of press, for a tool with constant press, whose model cannot know it."""


class CanvasTilt(Mechanism):
    """See the module. Where all strokes have the same press, only the mark's width changes."""

    cause = "canvas_tilt"
    site = "width"
    driving_covariate = "place"
    informative_covariates = ("place_x_m", "place_y_m")
    quantities = (
        Quantity("x_m", "m of press at the edge", 0.0004),
        Quantity("y_m", "m of press at the edge", 0.0004),
    )

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        return place(context) | ({} if press_varies(context) else {"half_width_per_press": _WIDTH_PER_PRESS})

    def executed(self, path: Tensor, context: StrokeContext) -> Tensor:
        if "half_width_per_press" in self.reference:
            return path
        return torch.cat([path[..., :3], (path[..., 3] - self._deeper_m(context))[..., None], path[..., 4:]], dim=-1)

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        if "half_width_per_press" not in self.reference:
            return mark
        wider = self.reference["half_width_per_press"] * self._deeper_m(context)
        return mark._replace(radius_m=(mark.radius_m + wider).clamp(min=1e-5))

    def _deeper_m(self, context: StrokeContext) -> Tensor:
        return (relative_place(context.path[..., 1:3], self.reference) * self.values).sum(-1)
