"""param2stroke (thesis 4.3.2): from a stroke's length, bend and press to a map of its coverage."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate

from pentimento.dynamics.strokes.samples import StrokeSamples
from studies.stroke_models.networks.coverage import CoverageModel, PressRange, numbers_of, unmirrored
from studies.stroke_models.networks.frame import Crop, place

COARSER = 4
"""Times by which the bilinear upscaler enlarges; the crop's sides are multiples of it."""
_HIDDEN, _MAPS, _CHANNELS = 64, 4, 8
_FIRST = -3.0
"""Logit of coverage before anything is learnt: paper."""


class Param2Stroke(CoverageModel):
    """Two linear layers, two convolutions, and a bilinear upscaler."""

    draws_from_numbers = True

    def __init__(self, crop: Crop, press: PressRange) -> None:
        super().__init__()
        self.crop, self.press = crop, press
        self.coarse = crop.height // COARSER, crop.width // COARSER
        self.linear = nn.Sequential(
            nn.Linear(3, _HIDDEN), nn.SiLU(), nn.Linear(_HIDDEN, _MAPS * self.coarse[0] * self.coarse[1]), nn.SiLU()
        )
        self.convolutions = nn.Sequential(
            nn.Conv2d(_MAPS, _CHANNELS, 3, padding=1), nn.SiLU(), nn.Conv2d(_CHANNELS, 1, 3, padding=1)
        )
        nn.init.constant_(self.convolutions[-1].bias, _FIRST)  # type: ignore[arg-type]

    def forward(self, samples: StrokeSamples) -> Tensor:
        """Coverage of the samples' windows, [B, H, W]."""
        mirror = self.mirror(len(samples.path))
        maps = self.linear(shape_numbers(numbers_of(samples.path, self.press, mirror)))
        coarse = self.convolutions(maps.unflatten(1, (_MAPS, *self.coarse)))
        fine = interpolate(coarse, scale_factor=float(COARSER), mode="bilinear", align_corners=False)[:, 0]
        return place(unmirrored(torch.sigmoid(fine), mirror), self.crop, samples)


def shape_numbers(numbers: Tensor) -> Tensor:
    """Length, bend and press [B, 3] of paths [B, N, 3] (``numbers_of``): the Bézier stroke (4.3.1) nearest to each."""
    t = torch.linspace(0.0, 1.0, numbers.shape[1])
    across = 3 * t * (1 - t)
    bend = (numbers[..., 1] * across).sum(1) / across.square().sum()
    return torch.stack([numbers[:, -1, 0], bend, numbers[..., 2].mean(1)], dim=1)
