"""The compiled renderer as a PyTorch function."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from pentimento.render.kernel import RenderInputError, render, render_backward
from pentimento.render.strokes import PixelStrokes


class _Render(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *inputs: Tensor | None) -> Tensor:
        points, radius, density, softness, color, canvas, pickup = map(_as_array, inputs)
        ctx.strokes = PixelStrokes(points, radius, density, softness, color, pickup)
        image, ctx.fragments = render(ctx.strokes, canvas, threads=torch.get_num_threads())
        return torch.from_numpy(image)

    @staticmethod
    def backward(ctx: Any, *image_gradient: Tensor) -> tuple[Tensor | None, ...]:
        of_image, threads = _as_array(image_gradient[0]), torch.get_num_threads()
        gradients = render_backward(ctx.strokes, ctx.fragments, of_image, threads=threads)
        return tuple(None if g is None else torch.from_numpy(g) for g in gradients)


def _as_array(tensor: Tensor | None) -> Any:
    return None if tensor is None else tensor.detach().contiguous().numpy()


def render_strokes(strokes: PixelStrokes[Tensor], canvas: Tensor) -> Tensor:
    """Lay strokes on canvases, in order; differentiable in everything.

    On the CPU by ``pentimento.render``, with as many threads as ``torch.get_num_threads()``; on a GPU by Triton.

    Args:
        canvas: [B, H, W, 3], linear light; with ``strokes.pickup`` [B, H, W, 4], the last channel being wetness, 0 to
            1.

    Returns:
        The images, of the canvas's shape, on the device of the strokes.

    Raises:
        RenderInputError: shapes do not fit, a value is not finite, memory is too small for the strokes, or the GPU
            renderer does not support the input.
    """
    if strokes.points.is_cuda:
        return _render_on_gpu(strokes, canvas)
    *fields, pickup = strokes
    image: Tensor = _Render.apply(*fields, canvas, pickup)  # type: ignore[no-untyped-call]
    return image


def _render_on_gpu(strokes: PixelStrokes[Tensor], canvas: Tensor) -> Tensor:
    if strokes.pickup is not None:
        raise RenderInputError(
            "The GPU renderer does not support paint pickup, which moves paint between tiles: move the tensors to the "
            "CPU."
        )
    try:
        from pentimento.dynamics.strokes.triton_kernel import render_triton
    except ImportError as error:
        raise RenderInputError(
            f"Strokes on {strokes.points.device} need Triton, which cannot be imported ({error}): install "
            "pentimento[gpu], or move the tensors to the CPU."
        ) from error
    return render_triton(strokes, canvas)
