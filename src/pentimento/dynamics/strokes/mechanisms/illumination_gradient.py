"""Brightness changes linearly over the photograph."""

from __future__ import annotations

import torch
from torch import Tensor

from pentimento.dynamics.strokes.mechanisms.geometry import pixel_places, place, relative_place
from pentimento.dynamics.strokes.simulation import Mechanism, Quantity, StrokeContext, View


class IlluminationGradient(Mechanism):
    cause = "illumination_gradient"
    site = "camera"
    driving_covariate = "place"
    informative_covariates = ("place_x_m", "place_y_m")
    quantities = (
        Quantity("paint_x", "1", 0.2),
        Quantity("paint_y", "1", 0.2),
        Quantity("picture_x", "1", 0.05),
        Quantity("picture_y", "1", 0.05),
    )

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        return place(context)

    def composite(self, color: Tensor, pickup: Tensor | None, context: StrokeContext) -> tuple[Tensor, Tensor | None]:
        # Both photographs have the error: the ground shows it already, the new paint does not.
        at = context.path[..., 1:3].mean(-2)
        return color * torch.exp(self._gain(at, self.values[:2])), pickup

    def camera(self, image: Tensor, view: View) -> Tensor:
        # An error of the photograph after the stroke alone acts on all of it.
        return image * torch.exp(self._gain(pixel_places(view, image), self.values[2:]))

    def _gain(self, xy_m: Tensor, values: Tensor) -> Tensor:
        at = relative_place(xy_m, self.reference)
        return at[..., :1] * values[0] + at[..., 1:] * values[1]
