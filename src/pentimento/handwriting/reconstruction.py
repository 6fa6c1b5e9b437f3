"""How near a TrajVAE comes to strokes that it has not learned from, in millimetres."""

from __future__ import annotations

import torch
from torch import Tensor

from pentimento.handwriting.trajvae import Strokes, TrajVAE


def reconstruction_mm(model: TrajVAE, strokes: Strokes) -> float:
    """Mean distance of points from where they are decoded from their strokes' mean latents."""
    with torch.no_grad():
        xy, _ = model.decode(model.encode(strokes)[0])
    return distance_mm(xy, strokes.xy_m)


def nearest_mm(known: Strokes, strokes: Strokes) -> float:
    """The same, if for each stroke the nearest known one is taken: what a copy of demonstrations reaches."""
    apart = (strokes.xy_m[:, None] - known.xy_m).norm(dim=-1).mean(-1)
    return float(apart.min(1).values.mean() * 1e3)


def mean_stroke_mm(known: Strokes, strokes: Strokes) -> float:
    """The same, if the mean of the known strokes is taken for each."""
    return distance_mm(known.xy_m.mean(0, keepdim=True).expand_as(strokes.xy_m), strokes.xy_m)


def distance_mm(one_m: Tensor, other_m: Tensor) -> float:
    """Mean distance between points [B, N, 2] in metres."""
    return float((one_m - other_m).norm(dim=-1).mean() * 1e3)
