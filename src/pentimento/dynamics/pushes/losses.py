"""How far one height map is from another: in height (thesis 7.1) and in its spatial gradient (7.2)."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import pad


def gradient(image: Tensor) -> Tensor:
    """[B, H, W] to [B, 2, H, W]: central differences along columns and rows, per pixel; the edge is repeated."""
    wide = pad(image[:, None], (1, 1, 1, 1), mode="replicate")[:, 0]
    across = (wide[:, 1:-1, 2:] - wide[:, 1:-1, :-2]) / 2
    down = (wide[:, 2:, 1:-1] - wide[:, :-2, 1:-1]) / 2
    return torch.stack([across, down], dim=1)


def inner(known: Tensor) -> Tensor:
    """[B, H, W]: which of the known pixels have four known neighbours, so that their gradient is known."""
    wide = pad(known, (1, 1, 1, 1))
    middle = wide[:, 1:-1, 1:-1]
    return middle & wide[:, :-2, 1:-1] & wide[:, 2:, 1:-1] & wide[:, 1:-1, :-2] & wide[:, 1:-1, 2:]


def height_errors(difference_m: Tensor, known: Tensor) -> Tensor:
    """L_3D of each of [B, H, W] differences: mean square over the known pixels, in mm²."""
    weight = known.to(difference_m.dtype)
    return (1e3 * difference_m).square().mul(weight).sum((1, 2)) / weight.sum((1, 2)).clamp(min=1.0)


def slope_errors(difference_m: Tensor, known: Tensor, pixels_per_m: float) -> Tensor:
    """L_viz of each of [B, H, W] differences: mean square length of the gradient, 1 (metres a metre).

    Over pixels whose gradient is known.
    """
    weight = inner(known).to(difference_m.dtype)
    steep = (pixels_per_m * gradient(difference_m)).square().sum(1)
    return (steep * weight).sum((1, 2)) / weight.sum((1, 2)).clamp(min=1.0)
