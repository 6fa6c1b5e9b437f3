"""Last layers fitted to resampled pushes: an ensemble at little more than the cost of one network.

The members share all layers but the last convolution. Each member's last convolution is fitted to the same pushes with
other weights, drawn from a flat Dirichlet distribution (the Bayesian bootstrap, Rubin 1981); pushes are resampled as a
whole, since the residuals of their pixels are correlated. The loss is quadratic in these weights, and the features are
computed once. The members' spread is the uncertainty of the last layer alone: intervals need what the residuals show in
addition (``uncertainty``).
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from pentimento.dynamics.pushes.param2deform import Param2Deform
from pentimento.dynamics.pushes.pose import Crop, PoseSamples, height_errors, slope_errors

_ITERATIONS = 20
"""Of L-BFGS, on all pushes at once."""


def losses(difference_m: Tensor, known: Tensor, pixels_per_m: float, *, visual_weight: float) -> Tensor:
    """L_3D + ``visual_weight`` · L_viz [B] of [B, H, W] differences, mm²."""
    total = height_errors(difference_m, known)
    if visual_weight:
        total = total + visual_weight * slope_errors(difference_m, known, pixels_per_m)
    return total


def fit_last_layers(
    members: Sequence[Param2Deform], samples: PoseSamples, crop: Crop, *, visual_weight: float, seed: int
) -> None:
    """Fit the last layer of each member, all of which are copies of one trained network, in place."""
    every = torch.ones(len(samples.state), dtype=torch.bool)
    both = [samples, samples.mirrored(every)]
    known, change, context = (
        torch.cat(pair) for pair in zip(*((s.known, s.change, s.context) for s in both), strict=True)
    )
    with torch.no_grad():
        seen = [members[0].features(s.state, s.length_m, s.depth_m, s.context) for s in both]
    dent, features = (torch.cat(pair) for pair in zip(*seen, strict=True))
    generator = torch.Generator().manual_seed(seed)
    for member in members:
        exponential = -torch.rand(len(every), generator=generator).clamp(min=1e-12).log()
        weight = (exponential / exponential.sum()).repeat(2) / 2
        layer = list(member.last_layer.parameters())
        optimizer = torch.optim.LBFGS(layer, max_iter=_ITERATIONS, line_search_fn="strong_wolfe")

        def closure(member: Param2Deform = member, weight: Tensor = weight) -> Tensor:
            for parameter in member.parameters():
                parameter.grad = None
            difference = member.change(dent, features, context) - change
            value = (weight * losses(difference, known, crop.pixels_per_m, visual_weight=visual_weight)).sum()
            torch.autograd.backward(value)
            return value

        optimizer.step(closure)  # type: ignore[no-untyped-call]
