"""Brightness falls with the square of the distance from the photograph's centre."""

from __future__ import annotations

import torch
from torch import Tensor

from pentimento.dynamics.strokes.mechanisms.geometry import pixel_places, place, relative_place
from pentimento.dynamics.strokes.simulation import Mechanism, Quantity, StrokeContext, View


class Vignetting(Mechanism):
    cause = "vignetting"
    site = "camera"
    driving_covariate = "place"
    informative_covariates = ("place_x_m", "place_y_m")
    quantities = (
        Quantity("paint", "1", 0.2),
        Quantity("picture", "1", 0.05),
    )

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        return place(context)

    def composite(self, color: Tensor, pickup: Tensor | None, context: StrokeContext) -> tuple[Tensor, Tensor | None]:
        # Both photographs have the error: the ground shows it already, the new paint does not.
        at = context.path[..., 1:3].mean(-2)
        return color * torch.exp(self._gain(at, self.values[:1])), pickup

    def camera(self, image: Tensor, view: View) -> Tensor:
        # An error of the photograph after the stroke alone acts on all of it.
        return image * torch.exp(self._gain(pixel_places(view, image), self.values[1:]))

    def _gain(self, xy_m: Tensor, values: Tensor) -> Tensor:
        return -values * relative_place(xy_m, self.reference).square().sum(-1, keepdim=True)
