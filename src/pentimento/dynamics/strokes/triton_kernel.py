"""The stroke renderer on a GPU, by Triton: the formula and the gradients of ``pentimento.render``.

The canvas is cut into square tiles, and every segment is listed for each tile that its ink can reach (``tiles``, which
defines visits and touches). One program a tile renders its strokes in order (``triton_programs``). For the gradients it
keeps, for each visit, the winning segment and the colour below: memory grows with touched tiles, not with strokes ×
canvas.

Gradients are deterministic: each program writes its sums to separate memory, one place a touch, and the sums of a
segment are added in a fixed order. No two programs add to one number.

Importing this module imports Triton; do so only on a machine with a GPU. With TRITON_INTERPRET=1 in the environment at
that time it runs on CPU tensors, slowly, which is how it is tested without a GPU.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import torch
import triton
from torch import Tensor
from torch.autograd.function import once_differentiable

from pentimento.dynamics.strokes.tiles import TILE, Touches, find_touches, tile_grid
from pentimento.dynamics.strokes.triton_programs import PATH, SUMS, paint_tile, unpaint_tile
from pentimento.render.kernel import RenderInputError
from pentimento.render.strokes import PixelStrokes

_FLOATS = (torch.float32, torch.float64)


class _Sizes(NamedTuple):
    """Arguments of the programs."""

    height: int
    width: int
    tiles_a_row: int
    tiles: int
    """Of a painting."""


class _Visits(NamedTuple):
    """What the gradients need of each visit."""

    winner: Tensor
    """int[V, pixels], the winning segment; -1: no ink."""
    below: Tensor
    """[V, 3, pixels], the colour below."""


def render_triton(strokes: PixelStrokes[Tensor], canvas: Tensor) -> Tensor:
    """Lay strokes on canvases, in order; differentiable once in everything. See ``pentimento.render`` for the formula.

    Args:
        strokes: without pickup.
        canvas: [B, H, W, 3], linear light; left as it is.

    Returns:
        [B, H, W, 3], on the device of the inputs.

    Raises:
        RenderInputError: shapes, types or devices do not fit, a value is not finite (the sentence names the first
            offender), or the strokes need more memory than the device has.
    """
    _check_inputs(strokes, canvas)
    profile = [strokes.radius, strokes.density, strokes.softness]
    path = torch.cat([strokes.points, *(values[..., None] for values in profile)], dim=-1)
    image: Tensor = _Render.apply(path, strokes.color, canvas)  # type: ignore[no-untyped-call]
    return image


class _Render(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, path: Tensor, color: Tensor, canvas: Tensor) -> Tensor:
        path, color, canvas = path.contiguous(), color.contiguous(), canvas.contiguous()
        with _shortage_named(path, canvas):
            touches = find_touches(path, canvas.shape[1], canvas.shape[2])
            image, visits = _launch_forward(path, color, canvas, touches=touches, keep=any(ctx.needs_input_grad))
        ctx.save_for_backward(path, color, *visits, *touches)
        return image

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *image_gradient: Tensor) -> tuple[Tensor, ...]:
        path, color, winner, below, *lists = ctx.saved_tensors
        touches, visits = Touches(*lists), _Visits(winner, below)
        with _shortage_named(path, image_gradient[0]):
            of_image = image_gradient[0].contiguous()
            g_canvas, sums = _launch_backward(path, color, of_image, touches=touches, visits=visits)
            g_path, g_color = _add_up(sums, touches.per_segment, path.shape)
        return g_path, g_color, g_canvas


@contextmanager
def _shortage_named(path: Tensor, canvas: Tensor) -> Iterator[None]:
    try:
        yield
    except torch.OutOfMemoryError as error:
        strokes, points = path.shape[0] * path.shape[1], path.shape[2]
        raise RenderInputError(
            f"{strokes} strokes of {points} points on canvases {tuple(canvas.shape)} do not fit into the memory of "
            f"{path.device}: render fewer paintings at a time, or on the CPU. ({error})"
        ) from error


def _launch_forward(
    path: Tensor, color: Tensor, canvas: Tensor, *, touches: Touches, keep: bool
) -> tuple[Tensor, _Visits]:
    """The images; and the visits, none unless they are to be kept."""
    image = torch.empty_like(canvas)
    n_points, pixels = path.shape[2], TILE * TILE
    visits = len(touches.visit_stroke) if keep else 0
    index = torch.int16 if n_points < 2**15 else torch.int32
    winner = torch.empty(visits, pixels, dtype=index, device=path.device)
    below = torch.empty(visits, 3, pixels, dtype=path.dtype, device=path.device)
    constant = (path[..., 3:] == path[..., :1, 3:]).flatten(2).all(2).to(torch.int8)
    with torch.cuda.device_of(path):  # type: ignore[no-untyped-call]
        paint_tile[(len(touches.tile_start) - 1,)](
            path, color, constant, canvas, image, *touches[:4], winner, below, n_points, *_sizes(canvas),
            KEEP=keep, SIDE=TILE,
        )  # fmt: skip
    return image, _Visits(winner, below)


def _launch_backward(
    path: Tensor, color: Tensor, g_image: Tensor, *, touches: Touches, visits: _Visits
) -> tuple[Tensor, Tensor]:
    """The canvas's gradient, and 13 sums for each touch, ordered by stroke and segment."""
    g_canvas = torch.empty_like(g_image)
    sums = torch.zeros(len(touches.slot), SUMS.value, dtype=path.dtype, device=path.device)
    with torch.cuda.device_of(path):  # type: ignore[no-untyped-call]
        unpaint_tile[(len(touches.tile_start) - 1,)](
            path, color, g_image, g_canvas, *touches[:5], *visits, sums, path.shape[2], *_sizes(g_image),
            SIDE=TILE,
        )  # fmt: skip
    return g_canvas, sums


def _add_up(sums: Tensor, per_segment: Tensor, shape: torch.Size) -> tuple[Tensor, Tensor]:
    """The gradients of paths of ``shape`` [B, S, N, 5] and of colours, from each touch's sums, segment by segment."""
    batch, strokes, points, _ = shape
    g_path, segments = sums.new_zeros(shape), max(points - 1, 1)
    if len(sums) == 0:
        return g_path, sums.new_zeros(batch, strokes, 3)
    total = torch.segment_reduce(sums, "sum", lengths=per_segment, axis=0, unsafe=True)
    total = total.view(batch, strokes, segments, -1)
    fields = PATH.value
    g_path[:, :, :segments] += total[..., :fields]
    g_path[:, :, points - segments :] += total[..., fields : 2 * fields]
    return g_path, total[..., 2 * fields :].sum(2)


def _sizes(canvas: Tensor) -> _Sizes:
    height, width = canvas.shape[1:3]
    rows, columns = tile_grid(height, width)
    return _Sizes(height, width, columns, rows * columns)


def _check_inputs(strokes: PixelStrokes[Tensor], canvas: Tensor) -> None:
    points = strokes.points
    if points.ndim != 4 or points.shape[-1] != 2 or points.shape[2] == 0 or canvas.ndim != 4 or canvas.numel() == 0:
        raise RenderInputError(
            "The renderer needs points [B, S, N, 2] and a canvas [B, H, W, 3]; got "
            f"{tuple(points.shape)} and {tuple(canvas.shape)}."
        )
    if not points.is_cuda and isinstance(paint_tile, triton.runtime.JITFunction):
        raise RenderInputError(f"The Triton renderer needs tensors on a GPU, not on {points.device}: use the CPU's.")
    batch, count, n, _ = points.shape
    wanted = {
        "points": (points, points.shape),
        "radius": (strokes.radius, (batch, count, n)),
        "density": (strokes.density, (batch, count, n)),
        "softness": (strokes.softness, (batch, count, n)),
        "color": (strokes.color, (batch, count, 3)),
        "canvas": (canvas, (batch, *canvas.shape[1:3], 3)),
    }
    for name, (tensor, shape) in wanted.items():
        if tensor.shape != shape:
            raise RenderInputError(f"The renderer's {name} must have shape {tuple(shape)}, not {tuple(tensor.shape)}.")
        if (tensor.dtype, tensor.device) != (points.dtype, points.device) or tensor.dtype not in _FLOATS:
            raise RenderInputError(
                f"The renderer's {name} is {tensor.dtype} on {tensor.device}, but points are {points.dtype} on "
                f"{points.device}: all inputs must be float32, or all float64, on one device."
            )
    finite = torch.stack([torch.isfinite(tensor).all() for tensor, _ in wanted.values()]).tolist()  # one wait, not six
    for name, is_finite in zip(wanted, finite, strict=True):
        if not is_finite:
            tensor = wanted[name][0].detach()
            index = torch.nonzero(~torch.isfinite(tensor))[0].tolist()
            value = float(tensor[tuple(index)])
            raise RenderInputError(f"The renderer's {name}{index} is {value}: every value must be finite.")
