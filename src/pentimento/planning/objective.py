"""The print objective (thesis 4.3): the painting should look like the target, seen from near and from farther off."""

from __future__ import annotations

import torch
from torch import Tensor

from pentimento.stroke_dynamics.photometry import linear_to_srgb


def print_loss(image: Tensor, target: Tensor, distances_px: tuple[int, ...]) -> Tensor:
    """Mean squared difference in sRGB, averaged over viewing distances.

    Args:
        image, target: [H, W, 3], linear light.
        distances_px: side lengths of the squares over which light is averaged before comparing: 1 is the thesis's
            (4.3); larger ones see tone where a pixel sees only a black line on white.
    """
    losses = [(seen_from(image, d) - seen_from(target, d)).square().mean() for d in distances_px]
    return torch.stack(losses).mean()


def seen_from(image: Tensor, distance_px: int) -> Tensor:
    """SRGB [h, w, 3] of light averaged over squares of ``distance_px``; an edge that fills none is left out."""
    if distance_px > 1:
        # Squares overlap by half, so that no grid of theirs shows in the plan.
        stride = max(distance_px // 2, 1)
        image = torch.nn.functional.avg_pool2d(image.permute(2, 0, 1), distance_px, stride).permute(1, 2, 0)
    return linear_to_srgb(image)
