"""The compiled renderer as a PyTorch function."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from pentimento.render.kernel import render, render_backward


class _Render(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *inputs: Tensor) -> Tensor:
        points, radius, density, softness, color, canvas = (x.detach().contiguous().numpy() for x in inputs)
        image, ctx.fragments = render(points, radius, density, softness, color, canvas)
        ctx.strokes = (points, radius, density, softness, color)
        return torch.from_numpy(image)

    @staticmethod
    def backward(ctx: Any, *image_gradient: Tensor) -> tuple[Tensor, ...]:
        points, radius, density, softness, color = ctx.strokes
        gradients = render_backward(
            points, radius, density, softness, color, ctx.fragments, image_gradient[0].contiguous().numpy()
        )
        return tuple(torch.from_numpy(g) for g in gradients)


def render_strokes(
    points: Tensor, radius: Tensor, density: Tensor, softness: Tensor, color: Tensor, canvas: Tensor
) -> Tensor:
    """Lay strokes on canvases, in order; differentiable in everything.

    Args:
        points: [B, S, N, 2], pixel coordinates (column, row).
        radius, density, softness: [B, S, N]; radius in px.
        color: [B, S, 3], linear light.
        canvas: [B, H, W, 3], linear light.

    Returns:
        [B, H, W, 3], on the CPU.

    Raises:
        RenderInputError: shapes do not fit, or a value is not finite.
    """
    image: Tensor = _Render.apply(points, radius, density, softness, color, canvas)  # type: ignore[no-untyped-call]
    return image
