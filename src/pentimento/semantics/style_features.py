"""Local features of a picture without learned weights: colour, and contrast by scale and orientation.

A network with fixed weights and the components of VGG's first blocks (convolution, rectification, pooling): at each
scale a bank of Gabor filters in an opponent colour space, each in two phases whose modulus rectifies them, averaged
over cells. This is the first layer of a scattering transform (Bruna and Mallat 2013). A second layer, and half-wave
rectification instead of the modulus, did not rank textures better in tests; the second layer costs half as much again.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, conv2d, pad

from pentimento.contracts.errors import ConfigError
from pentimento.dynamics.strokes.photometry import linear_to_srgb

CELL_PX = 16
"""Side of the squares over which features are averaged."""
_SCALES = 4
_ORIENTATIONS = 4
_PERIOD_PX = 4.0
"""Of the finest gratings; each scale doubles it, up to two cells."""
_SIZE, _SIGMA_PX = 7, 1.6
_CONTRAST_GAIN = 2.0
"""Contrasts in photographs are a fraction of the range of colours; the gain gives both similar weights."""
_MIN_CONTRAST = 1e-3
"""Contrasts below it count as zero, so that the modulus is differentiable everywhere."""
OPPONENT = ((3**-0.5, 3**-0.5, 3**-0.5), (2**-0.5, -(2**-0.5), 0.0), (6**-0.5, 6**-0.5, -2 * 6**-0.5))
"""Rows: luminance, red against green, yellow against blue. Orthonormal, so distances of sRGB colours are preserved."""

LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Of linear sRGB (IEC 61966-2-1)."""


class LocalFeatures(nn.Module):
    """Pictures [H, W, 3] in linear light to sets [cells, 49] of local features; differentiable.

    Cells are squares of about `CELL_PX` that cover the picture. The features of a cell are the mean opponent colour
    (3); the covariance of its colours (6), which separates dark blue on light yellow from light blue on dark yellow;
    and the contrast in 4 orientations at periods of 4, 8, 16 and 32 px, of luminance and, except for the finest, of
    both colours (40). All are in units of sRGB.
    """

    bank: Tensor
    opponent: Tensor
    luminance: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("bank", gabor_bank(_ORIENTATIONS))
        self.register_buffer("opponent", torch.tensor(OPPONENT))
        self.register_buffer("luminance", torch.tensor(LUMINANCE))

    def forward(self, image: Tensor) -> Tensor:
        """The features of an image [H, W, 3].

        Raises:
            ConfigError: the image is smaller than a cell.
        """
        grid = cell_grid(image)
        planes = image.movedim(-1, 0)
        # From 2 px off, light is averaged before it is seen; only the finest contrast, of light alone, looks closer.
        fine = math.sqrt(3) * linear_to_srgb(torch.einsum("c,chw->hw", self.luminance, planes))
        seen = linear_to_srgb(_halved(planes[:, None])[:, 0])
        colors = torch.einsum("oc,chw->ohw", self.opponent, seen)
        # There are most samples to average at the finest scale: at every fourth pixel, textures rank as at every other.
        maps = [_spread(colors, grid), self._contrast(fine[None, None], grid, 4)]
        level = colors[:, None]
        for _ in range(_SCALES - 1):
            maps.append(self._contrast(level, grid, 2))
            level = _halved(level)
        return torch.cat(maps).flatten(1).T

    def _contrast(self, planes: Tensor, grid: tuple[int, int], stride: int) -> Tensor:
        """Amplitudes [P · orientations, *grid] of gratings in planes [P, 1, h, w]."""
        edge = _SIZE // 2
        response = conv2d(pad(planes, (edge,) * 4, mode="replicate"), self.bank, stride=stride)
        even_odd = response.reshape(-1, 2, *response.shape[-2:])
        amplitude = (even_odd.square().sum(1) + _MIN_CONTRAST**2).sqrt() - _MIN_CONTRAST
        return _CONTRAST_GAIN * cell_means(amplitude, grid)


def gabor_bank(orientations: int) -> Tensor:
    """Gabor filters [2 · orientations, 1, 7, 7]: for each orientation an even and an odd one.

    Their response to uniform light is 0. The modulus of the pair for a grating of amplitude 1 with their period and
    orientation is about 1 at every phase.
    """
    steps = torch.arange(_SIZE, dtype=torch.float64) - (_SIZE - 1) / 2
    y, x = torch.meshgrid(steps, steps, indexing="ij")
    window = torch.exp(-(x**2 + y**2) / (2 * _SIGMA_PX**2))
    filters = []
    for index in range(orientations):
        turn = math.pi * index / orientations
        phase = 2 * math.pi * (x * math.cos(turn) + y * math.sin(turn)) / _PERIOD_PX
        even, odd = window * torch.cos(phase), window * torch.sin(phase)
        even = even - window * even.sum() / window.sum()
        filters += [even / (even * torch.cos(phase)).sum(), odd / (odd * torch.sin(phase)).sum()]
    return torch.stack(filters)[:, None].float()


def cell_grid(image: Tensor) -> tuple[int, int]:
    """Rows and columns of the cells that cover an image [H, W, 3].

    Raises:
        ConfigError: the image is smaller than a cell.
    """
    height, width = image.shape[:2]
    if min(height, width) < CELL_PX:
        raise ConfigError(
            f"A picture of {height} x {width} px has no local features: its sides must be {CELL_PX} px or more. "
            "Raise the planner's pixels_per_m."
        )
    return round(height / CELL_PX), round(width / CELL_PX)


def cell_means(maps: Tensor, grid: tuple[int, int]) -> Tensor:
    """Means of maps [..., h, w] over a grid of equal cells, [..., *grid]; a pixel on a border counts for both cells by
    overlap.
    """
    rows, columns = (_shares(size, cells).to(maps) for size, cells in zip(maps.shape[-2:], grid, strict=True))
    return rows @ maps @ columns.T


def _shares(size: int, cells: int) -> Tensor:
    """Weights [cells, size] of samples in the mean of each cell, by overlap; rows sum to 1."""
    borders = torch.arange(cells + 1, dtype=torch.float64) * size / cells
    sample = torch.arange(size, dtype=torch.float64)
    upper, lower = torch.minimum(borders[1:, None], sample + 1), torch.maximum(borders[:-1, None], sample)
    return (upper - lower).clamp(min=0.0) * cells / size


def _spread(colors: Tensor, grid: tuple[int, int]) -> Tensor:
    """Mean colours and the covariance over the root of its trace, [9, *grid], of colours [3, h, w]."""
    mean = cell_means(colors, grid)
    first, second = torch.triu_indices(3, 3)
    product = cell_means(colors[first] * colors[second], grid)
    covariance = product - mean[first] * mean[second]
    size = (covariance[first == second].sum(0).clamp(min=0.0) + _MIN_CONTRAST).sqrt()
    twice = torch.where(first == second, 1.0, math.sqrt(2.0)).to(colors)  # an off-diagonal entry stands for two
    return torch.cat([mean, twice[:, None, None] * covariance / size])


def _halved(planes: Tensor) -> Tensor:
    """Means of 2 x 2 px; at an odd edge of the remaining pixels."""
    return avg_pool2d(planes, 2, ceil_mode=True)
