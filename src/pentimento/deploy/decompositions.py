"""Gradients that ONNX has no operator for, as compositions of operators that it has.

Each function replaces one operator of PyTorch while a function is traced.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch._decomp import core_aten_decompositions
from torch.fx.experimental.proxy_tensor import disable_proxy_modes_tracing
from torch.nn.functional import avg_pool2d

Decomposition = Callable[..., Any]

constant_pad_nd = torch.ops.aten.constant_pad_nd
_BILINEAR = 0  # as PyTorch numbers the modes of grid_sample
_ZEROS = 0
_BORDER = 1


@dataclass
class Resizing:
    """The matrices that resize pictures while a function is traced, as arguments of that function.

    Without them a traced graph would hold the matrices for one size of picture. `bundle.views.resizing_matrix` computes
    them.
    """

    rows: Tensor | None = None
    """[h', h]."""
    columns: Tensor | None = None
    """[w', w]."""

    def forward(self, image: Tensor, size: Sequence[int], align_corners: bool, *_scales: Any) -> Tensor:
        """[B, C, h, w] to [B, C, h', w']."""
        _require(not align_corners, "resizing with aligned corners")
        return _separably(self._given(self.rows), image, self._given(self.columns))

    def backward(
        self, gradient: Tensor, size: Sequence[int], image_size: Sequence[int], align_corners: bool, *_scales: Any
    ) -> Tensor:
        """[B, C, h', w'] to [B, C, h, w]: the transposed product."""
        _require(not align_corners, "resizing with aligned corners")
        return _separably(self._given(self.rows).T, gradient, self._given(self.columns).T)

    @staticmethod
    def _given(matrix: Tensor | None) -> Tensor:
        if matrix is None:
            raise NotImplementedError(
                "A picture is resized, but the function takes no matrices for that: give it them."
            )
        return matrix


def exportable(resizing: Resizing) -> Mapping[Any, Decomposition]:
    """The table for `make_fx`: the core operators, and gradients that they lack."""
    aten = torch.ops.aten
    return {
        **core_aten_decompositions(),
        aten.convolution_backward.default: _convolution_backward,
        aten._upsample_bicubic2d_aa.default: resizing.forward,
        aten._upsample_bicubic2d_aa_backward.default: resizing.backward,
        aten.affine_grid_generator.default: _affine_grid,
        aten.avg_pool2d_backward.default: _pooling_backward,
        aten.replication_pad2d_backward.default: _padding_backward,
        aten.select_backward.default: _select_backward,
        aten.slice_backward.default: _slice_backward,
        aten.grid_sampler_2d_backward.default: _grid_sampler_backward,
    }


def _convolution_backward(
    gradient: Tensor,
    image: Tensor,
    weight: Tensor,
    _bias_sizes: Sequence[int] | None,
    stride: Sequence[int],
    padding: Sequence[int],
    dilation: Sequence[int],
    transposed: bool,
    _output_padding: Sequence[int],
    groups: int,
    wanted: Sequence[bool],
) -> tuple[Tensor | None, None, None]:
    """∂loss/∂image of a convolution with frozen weights: the transposed convolution."""
    _require(not transposed and not any(wanted[1:]), "the gradient of a transposed convolution, or of weights")
    if not wanted[0]:
        return None, None, None
    reached = [
        (gradient.shape[2 + i] - 1) * stride[i] - 2 * padding[i] + dilation[i] * (weight.shape[2 + i] - 1) + 1
        for i in range(2)
    ]
    missing = [image.shape[2 + i] - reached[i] for i in range(2)]
    back = torch.ops.aten.convolution(gradient, weight, None, stride, padding, dilation, True, missing, groups)
    return back, None, None


def _separably(rows: Tensor, image: Tensor, columns: Tensor) -> Tensor:
    """rows [h', h] · image [B, C, h, w] · columnsᵀ [w, w'], as plain products of matrices."""
    batch, channels, height, width = image.shape
    across = (image.reshape(-1, width) @ columns.T).reshape(batch, channels, height, columns.shape[0])
    down = across.transpose(2, 3).reshape(-1, height) @ rows.T
    return down.reshape(batch, channels, columns.shape[0], rows.shape[0]).transpose(2, 3)


def _pooling_backward(
    gradient: Tensor,
    image: Tensor,
    kernel: Sequence[int],
    stride: Sequence[int],
    padding: Sequence[int],
    ceil_mode: bool,
    *_edges: Any,
) -> Tensor:
    """∂loss/∂image of average pooling: the transposed product with the pooled identity."""
    _require(not any(padding), "pooling with padding")

    def means(size: int, axis: int) -> Tensor:
        with disable_proxy_modes_tracing():
            lines = torch.eye(size)[None]
            shape = (kernel[axis], 1)
            return avg_pool2d(lines, shape, (stride[axis] if stride else kernel[axis], 1), 0, ceil_mode)[
                0
            ].T.contiguous()

    return _separably(means(image.shape[2], 0), gradient, means(image.shape[3], 1))


def _padding_backward(gradient: Tensor, image: Tensor, padding: Sequence[int]) -> Tensor:
    """∂loss/∂image of replication padding: the gradients of all copies are summed at the edge."""
    left, right, top, bottom = padding

    def copies(size: int, before: int, after: int) -> Tensor:
        with disable_proxy_modes_tracing():
            source = torch.arange(-before, size + after).clamp(0, size - 1)
            return (torch.arange(size)[:, None] == source).float()

    return _separably(copies(image.shape[2], top, bottom), gradient, copies(image.shape[3], left, right))


def _select_backward(gradient: Tensor, sizes: Sequence[int], axis: int, index: int) -> Tensor:
    """∂loss/∂tensor of one entry along an axis: the gradient surrounded by zeros.

    PyTorch's own decomposition takes four operators, which is slow where a path is computed point by point.
    """
    return _zeros_around(gradient.unsqueeze(axis), sizes, axis, index)


def _slice_backward(gradient: Tensor, sizes: Sequence[int], axis: int, start: int, _end: int, step: int) -> Tensor:
    """∂loss/∂tensor of a slice along an axis: the gradient surrounded by zeros."""
    _require(step == 1, "the gradient of a slice with a step")
    return _zeros_around(gradient, sizes, axis, start)


def _zeros_around(gradient: Tensor, sizes: Sequence[int], axis: int, start: int) -> Tensor:
    axis %= len(sizes)
    start = start if start >= 0 else start + sizes[axis]
    after = sizes[axis] - start - gradient.shape[axis]
    return constant_pad_nd(gradient, [0, 0] * (len(sizes) - 1 - axis) + [start, after], 0.0)


def _affine_grid(matrices: Tensor, size: Sequence[int], align_corners: bool) -> Tensor:
    """Sampling positions [B, h, w, 2] of the pixels of [B, C, h, w]. PyTorch's own decomposition fixes the size."""
    _require(not align_corners, "an affine grid with aligned corners")
    height, width = size[2:]
    x = ((2 * torch.arange(width) + 1) / width - 1)[None, None, :]
    y = ((2 * torch.arange(height) + 1) / height - 1)[None, :, None]
    places = [m[:, 0, None, None] * x + m[:, 1, None, None] * y + m[:, 2, None, None] for m in matrices.unbind(1)]
    return torch.stack(places, dim=-1)


def _grid_sampler_backward(
    gradient: Tensor, image: Tensor, grid: Tensor, mode: int, padding: int, align_corners: bool, wanted: Sequence[bool]
) -> tuple[Tensor | None, Tensor | None]:
    """∂loss/∂image and ∂loss/∂grid of bilinear sampling, in which each sample reads four pixels."""
    _require(mode == _BILINEAR and padding in (_ZEROS, _BORDER) and not align_corners, "this grid_sample")
    batch, channels, height, width = image.shape
    free_x, free_y = ((grid[..., 0] + 1) * width - 1) / 2, ((grid[..., 1] + 1) * height - 1) / 2
    # Beyond the image there are copies of its edge, or one ring of zeros and then nothing.
    ring = 1 if padding == _ZEROS else 0
    x = free_x.clamp(min=-float(ring)).clamp(max=width - 1 + ring)
    y = free_y.clamp(min=-float(ring)).clamp(max=height - 1 + ring)
    columns, rows = _two_beside(x, width, ring), _two_beside(y, height, ring)
    first = (torch.arange(batch) * (height * width))[:, None, None]
    samples = gradient.permute(0, 2, 3, 1)
    pixels = image.permute(0, 2, 3, 1).reshape(-1, channels)
    back = torch.zeros(batch * height * width, channels)
    to_x, to_y = torch.zeros_like(x), torch.zeros_like(y)
    for row, row_share, row_slope in rows:
        for column, column_share, column_slope in columns:
            pixel = (first + row * width + column).reshape(-1)
            if wanted[0]:
                given = (samples * (row_share * column_share)[..., None]).reshape(-1, channels)
                back = back.index_put((pixel,), given, accumulate=True)
            if wanted[1]:
                along = (samples * pixels[pixel].reshape(samples.shape)).sum(-1)
                to_x = to_x + along * row_share * column_slope
                to_y = to_y + along * column_share * row_slope
    to_image = back.reshape(batch, height, width, channels).permute(0, 3, 1, 2) if wanted[0] else None
    if not wanted[1]:
        return to_image, None
    to_x = to_x * (free_x == x) * (width / 2)
    to_y = to_y * (free_y == y) * (height / 2)
    return to_image, torch.stack([to_x, to_y], dim=-1)


def _two_beside(place: Tensor, size: int, ring: int) -> list[tuple[Tensor, Tensor, Tensor]]:
    """The two pixels on both sides of each position along an axis: index, weight, and derivative of the weight.

    In the ring of zeros around the image, weight and derivative are 0.
    """
    first = place.floor()
    part = place - first
    found = []
    for pixel, share, slope in ((first, 1 - part, -1.0), (first + 1, part, 1.0)):
        slopes = torch.full_like(place, slope)
        if ring:
            there = (pixel >= 0) & (pixel <= size - 1)
            share, slopes = share * there, slopes * there
        found.append((pixel.clamp(min=0.0).clamp(max=size - 1).long(), share, slopes))
    return found


def _require(met: bool, what: str) -> None:
    if not met:
        raise NotImplementedError(f"An objective needs {what}, which has no exported form yet: add it here.")
