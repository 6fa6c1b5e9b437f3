"""Each decomposition equals the operator that it replaces."""

import pytest
import torch
from torch import Tensor
from torch.nn.functional import affine_grid, avg_pool2d, conv2d, grid_sample, interpolate, pad

from pentimento.deploy.decompositions import Resizing, exportable

ATEN = torch.ops.aten


def random(*shape: int) -> Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(sum(shape)))


def gradient(output: Tensor, image: Tensor) -> tuple[Tensor, Tensor]:
    """A cotangent, and what PyTorch makes of it."""
    cotangent = random(*output.shape)
    return cotangent, torch.autograd.grad(output, image, cotangent)[0]


@pytest.mark.parametrize(
    ("side", "stride", "padding", "groups"), [(8, 1, 1, 1), (9, 2, 1, 1), (8, 2, 1, 2), (8, 4, 0, 1)]
)
def test_decomposed_convolution_gradient(side: int, stride: int, padding: int, groups: int) -> None:
    image, weight = random(2, 4, side, side + 1).requires_grad_(), random(6, 4 // groups, 3, 3)
    cotangent, expected = gradient(conv2d(image, weight, None, stride, padding, 1, groups), image)
    decomposed = exportable(Resizing())[ATEN.convolution_backward.default]
    lists = ([stride] * 2, [padding] * 2, [1, 1])
    found = decomposed(cotangent, image, weight, None, *lists, False, [0, 0], groups, [True, False, False])[0]
    torch.testing.assert_close(found, expected)


@pytest.mark.parametrize(("size", "new_size"), [((20, 12), (8, 8)), ((8, 8), (8, 8)), ((5, 30), (8, 8))])
def test_decomposed_resizing_and_its_gradient(size: tuple[int, int], new_size: tuple[int, int]) -> None:
    image = random(2, 3, *size).requires_grad_()
    resized = interpolate(image, new_size, mode="bicubic", antialias=True, align_corners=False)
    cotangent, expected = gradient(resized, image)
    lines = (
        interpolate(torch.eye(a)[None, None], (b, a), mode="bicubic", antialias=True)[0, 0]
        for a, b in zip(size, new_size, strict=True)
    )
    table = exportable(Resizing(*lines))
    found = table[ATEN._upsample_bicubic2d_aa.default](image, new_size, False)
    torch.testing.assert_close(found, resized)
    back = table[ATEN._upsample_bicubic2d_aa_backward.default](cotangent, new_size, image.shape, False)
    torch.testing.assert_close(back, expected)


def test_rejects_resizing_without_matrices() -> None:
    with pytest.raises(NotImplementedError, match="takes no matrices"):
        Resizing().forward(random(1, 3, 8, 8), (4, 4), False)


def test_decomposed_affine_grid_and_sampling_gradient_beyond_the_edge() -> None:
    image = random(2, 3, 7, 11).requires_grad_()
    matrices = torch.tensor([[[1.4, -0.3, 0.2], [0.3, 0.8, -0.4]], [[0.5, 0.0, 0.9], [0.0, 0.5, 0.9]]])
    grid = affine_grid(matrices, [2, 3, 7, 11], align_corners=False)
    table = exportable(Resizing())
    torch.testing.assert_close(table[ATEN.affine_grid_generator.default](matrices, [2, 3, 7, 11], False), grid)
    seen = grid_sample(image, grid, mode="bilinear", padding_mode="border", align_corners=False)
    cotangent, expected = gradient(seen, image)
    found = table[ATEN.grid_sampler_2d_backward.default](cotangent, image, grid, 0, 1, False, [True, False])[0]
    torch.testing.assert_close(found, expected)


@pytest.mark.parametrize(("padding", "number"), [("zeros", 0), ("border", 1)])
def test_decomposed_sampling_gradient_in_the_grid(padding: str, number: int) -> None:
    image = random(2, 3, 7, 11).requires_grad_()
    grid = (3 * random(2, 9, 5, 2) - 1.5).requires_grad_()  # a third of the samples is beyond the edge
    seen = grid_sample(image, grid, mode="bilinear", padding_mode=padding, align_corners=False)
    cotangent = random(*seen.shape)
    expected = torch.autograd.grad(seen, (image, grid), cotangent)
    decomposed = exportable(Resizing())[ATEN.grid_sampler_2d_backward.default]
    found = decomposed(cotangent, image, grid, 0, number, False, [True, True])
    torch.testing.assert_close(found, expected, atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("size", [(6, 8), (7, 9)])
def test_decomposed_pooling_gradient_at_odd_edges(size: tuple[int, int]) -> None:
    image = random(3, 1, *size).requires_grad_()
    cotangent, expected = gradient(avg_pool2d(image, 2, ceil_mode=True), image)
    decomposed = exportable(Resizing())[ATEN.avg_pool2d_backward.default]
    torch.testing.assert_close(decomposed(cotangent, image, [2, 2], [2, 2], [0, 0], True, True, None), expected)


def test_decomposed_replication_padding_gradient() -> None:
    image = random(1, 2, 5, 6).requires_grad_()
    cotangent, expected = gradient(pad(image, (3, 1, 2, 4), mode="replicate"), image)
    decomposed = exportable(Resizing())[ATEN.replication_pad2d_backward.default]
    torch.testing.assert_close(decomposed(cotangent, image, [3, 1, 2, 4]), expected)


@pytest.mark.parametrize(("axis", "index"), [(0, 0), (1, -1), (-1, 2)])
def test_decomposed_select_gradient(axis: int, index: int) -> None:
    tensor = random(3, 4, 5).requires_grad_()
    cotangent, expected = gradient(tensor.select(axis, index), tensor)
    decomposed = exportable(Resizing())[ATEN.select_backward.default]
    torch.testing.assert_close(decomposed(cotangent, tensor.shape, axis, index), expected)


@pytest.mark.parametrize(("axis", "start", "end"), [(0, 1, 3), (1, 0, 2**63 - 1), (-1, -3, -1), (2, 2, 9)])
def test_decomposed_slice_gradient(axis: int, start: int, end: int) -> None:
    tensor = random(3, 4, 5).requires_grad_()
    cotangent, expected = gradient(torch.ops.aten.slice(tensor, axis, start, end), tensor)
    decomposed = exportable(Resizing())[ATEN.slice_backward.default]
    torch.testing.assert_close(decomposed(cotangent, tensor.shape, axis, start, end, 1), expected)


def test_rejects_gradients_without_decomposition() -> None:
    table, image = exportable(Resizing()), random(1, 2, 4, 4)
    with pytest.raises(NotImplementedError, match="of weights"):
        table[ATEN.convolution_backward.default](
            image, image, image, None, [1, 1], [1, 1], [1, 1], False, [0, 0], 1, [True, True, False]
        )
    with pytest.raises(NotImplementedError, match="grid_sample"):
        table[ATEN.grid_sampler_2d_backward.default](image, image, image, 2, 1, False, [True, False])
