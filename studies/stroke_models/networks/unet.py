"""A small U-Net (Ronneberger et al. 2015) whose last convolution starts at zero, as ControlNet's do (Zhang et al.
2023).
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate, max_pool2d, pixel_shuffle, pixel_unshuffle

COARSER = 8
"""Sides of its images are multiples of it."""
_BLOCK = 2
_CHANNELS = (16, 32, 32)


class UNet(nn.Module):
    """Images [B, C, h, w] to [B, h, w], two levels down and up; untrained it gives 0 everywhere.

    It works on blocks of 2 × 2 pixels as channels, which costs a quarter.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        fine, middle, coarse = _CHANNELS
        self.down = nn.ModuleList([_layer(channels * _BLOCK**2, fine), _layer(fine, middle), _layer(middle, coarse)])
        self.up = nn.ModuleList([_layer(coarse + middle, middle), _layer(middle + fine, fine)])
        self.last = nn.Conv2d(fine, _BLOCK**2, 1)
        for parameter in self.last.parameters():
            nn.init.zeros_(parameter)

    def forward(self, images: Tensor) -> Tensor:
        """See the class."""
        fine = self.down[0](pixel_unshuffle(images, _BLOCK))
        middle = self.down[1](max_pool2d(fine, 2))
        coarse = self.down[2](max_pool2d(middle, 2))
        middle = self.up[0](torch.cat([_doubled(coarse), middle], dim=1))
        fine = self.up[1](torch.cat([_doubled(middle), fine], dim=1))
        return pixel_shuffle(self.last(fine), _BLOCK)[:, 0]


def _layer(before: int, after: int) -> nn.Sequential:
    convolution = nn.Conv2d(before, after, 3, padding=1)
    # PyTorch's own start shrinks what passes threefold a layer: the last, zero convolution would learn from nothing.
    nn.init.kaiming_normal_(convolution.weight, nonlinearity="relu")
    nn.init.zeros_(convolution.bias)  # type: ignore[arg-type]
    return nn.Sequential(convolution, nn.SiLU())


def _doubled(images: Tensor) -> Tensor:
    return interpolate(images, scale_factor=2.0, mode="bilinear", align_corners=False)
