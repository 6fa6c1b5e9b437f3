"""A softer edge in the terms of the renderer: the line of half darkness stays where it was."""

from __future__ import annotations

import torch
from torch import Tensor

from pentimento.dynamics.strokes.traj2stroke import Mark

_HARDEST = 0.05


def bleed(mark: Mark, softening: Tensor, spreading: Tensor) -> Mark:
    """The mark with a softness ``exp(softening)`` times as large, and everything ``exp(spreading)`` times as wide."""
    softer = mark.softness.clamp(min=_HARDEST) * torch.exp(softening)
    wider = mark.radius_m * _half_reach(mark.softness) / _half_reach(softer) * torch.exp(spreading)
    return mark._replace(radius_m=wider, softness=softer)


def _half_reach(softness: Tensor) -> Tensor:
    """Share of the radius at which a stroke is half as dark as on its path: (1 - D/R)^c = 1/2."""
    return 1 - torch.exp2(-1 / softness.clamp(min=_HARDEST))
