"""A model that was fitted to strokes in their own frames, made ready for strokes of any heading on the canvas."""

from __future__ import annotations

from dataclasses import replace

import torch

from pentimento.dynamics.strokes.extended import StrokeModel
from pentimento.dynamics.strokes.simulation import Mechanism, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark

_SHORTEST_M = 1e-9


class OwnFrame(Mechanism):
    """Scale and shift of a base model in each stroke's own frame: x from its start to its end, y to its left."""

    cause = "own_frame"
    site = "trajectory"
    driving_covariate = "extent"
    quantities = (
        Quantity("along", "1", 0.05),
        Quantity("across", "1", 0.05),
        Quantity("ahead_m", "m", 0.001),
        Quantity("left_m", "m", 0.001),
    )

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        path = context.path[..., 1:3]
        start, chord = path[..., :1, :], path[..., -1:, :] - path[..., :1, :]
        along = chord / chord.norm(dim=-1, keepdim=True).clamp(min=_SHORTEST_M)
        left = torch.stack([-along[..., 1], along[..., 0]], dim=-1)
        shape = mark.points_m - start
        ahead = (1 + self.values[0]) * (shape * along).sum(-1, keepdim=True) + self.values[2]
        aside = (1 + self.values[1]) * (shape * left).sum(-1, keepdim=True) + self.values[3]
        return mark._replace(points_m=start + ahead * along + aside * left)


def for_the_canvas(model: StrokeModel) -> StrokeModel:
    """Return the model with its base's scale and shift turned with each stroke."""
    (along, across), shift_m = model.parameters.scale, model.parameters.offset_m
    frame = OwnFrame(torch.tensor([along - 1, across - 1, *shift_m], dtype=torch.float32), {})
    parameters = replace(model.parameters, scale=(1.0, 1.0), offset_m=(0.0, 0.0))
    return replace(model, parameters=parameters, mechanisms=(frame, *model.mechanisms))
