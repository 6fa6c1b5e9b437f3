"""The compiled renderer as a PyTorch function."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from pentimento.render.kernel import RenderInputError, render, render_backward


class _Render(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *inputs: Tensor | None) -> Tensor:
        points, radius, density, softness, color, canvas, pickup = map(_as_array, inputs)
        threads = torch.get_num_threads()
        image, ctx.fragments = render(points, radius, density, softness, color, canvas, pickup, threads)
        ctx.strokes, ctx.pickup = (points, radius, density, softness, color), pickup
        return torch.from_numpy(image)

    @staticmethod
    def backward(ctx: Any, *image_gradient: Tensor) -> tuple[Tensor | None, ...]:
        points, radius, density, softness, color = ctx.strokes
        gradients = render_backward(
            points, radius, density, softness, color, ctx.fragments, _as_array(image_gradient[0]), ctx.pickup,
            torch.get_num_threads(),
        )  # fmt: skip
        return tuple(None if g is None else torch.from_numpy(g) for g in gradients)


def _as_array(tensor: Tensor | None) -> Any:
    return None if tensor is None else tensor.detach().contiguous().numpy()


def render_strokes(
    points: Tensor,
    radius: Tensor,
    density: Tensor,
    softness: Tensor,
    color: Tensor,
    canvas: Tensor,
    pickup: Tensor | None = None,
) -> Tensor:
    """Lay strokes on canvases, in order; differentiable in everything.

    On the CPU by ``pentimento.render``, with as many threads as ``torch.get_num_threads()``; on a GPU by Triton.

    Args:
        points: [B, S, N, 2], pixel coordinates (column, row).
        radius, density, softness: [B, S, N]; radius in px.
        color: [B, S, 3], linear light.
        canvas: [B, H, W, 3], linear light; with ``pickup`` [B, H, W, 4], the last channel being wetness, 0 to 1.
        pickup: [B, S], the share of wet paint that each stroke picks up; None: none.

    Returns:
        The images, of the canvas's shape, where the points are.

    Raises:
        RenderInputError: shapes do not fit, a value is not finite, memory is too small for the strokes, or the GPU
            renderer does not support the input.
    """
    if points.is_cuda:
        return _render_on_gpu(points, radius, density, softness, color, canvas, pickup)
    inputs = (points, radius, density, softness, color, canvas, pickup)
    image: Tensor = _Render.apply(*inputs)  # type: ignore[no-untyped-call]
    return image


def _render_on_gpu(
    points: Tensor,
    radius: Tensor,
    density: Tensor,
    softness: Tensor,
    color: Tensor,
    canvas: Tensor,
    pickup: Tensor | None,
) -> Tensor:
    if pickup is not None:
        raise RenderInputError(
            "The GPU renderer does not support paint pickup, which moves paint between tiles: move the tensors to the "
            "CPU."
        )
    try:
        from pentimento.dynamics.strokes.triton_kernel import render_triton
    except ImportError as error:
        raise RenderInputError(
            f"Strokes on {points.device} need Triton, which cannot be imported ({error}): install pentimento[gpu], or "
            "move the tensors to the CPU."
        ) from error
    return render_triton(points, radius, density, softness, color, canvas)
