"""The thesis's CNN (5.4.3): a whole trajectory through a linear layer and transposed convolutions."""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn.functional import silu

from pentimento.dynamics.strokes.samples import StrokeSamples
from studies.stroke_models.networks.coverage import CoverageModel, PressRange, numbers_of, unmirrored
from studies.stroke_models.networks.frame import Crop, place

COARSER = 8
"""Times by which the transposed convolutions enlarge; the crop's sides are multiples of it."""
_HIDDEN, _CHANNELS = 128, (32, 16, 8, 1)
_FIRST = -3.0


class TrajectoryCnn(CoverageModel):
    """Paths of N points to coverage.

    ``coordinates``: CoordConv (Liu et al. 2018), two further channels with each pixel's x and y in each convolution.
    """

    draws_from_numbers = True

    def __init__(self, crop: Crop, press: PressRange, points: int, coordinates: bool) -> None:
        super().__init__()
        self.crop, self.press = crop, press
        self.coarse = crop.height // COARSER, crop.width // COARSER
        self.linear = nn.Sequential(
            nn.Linear(3 * points, _HIDDEN), nn.SiLU(),
            nn.Linear(_HIDDEN, _CHANNELS[0] * self.coarse[0] * self.coarse[1]), nn.SiLU(),
        )  # fmt: skip
        self.coordinates = coordinates
        more = 2 if coordinates else 0
        self.enlarging = nn.ModuleList(nn.ConvTranspose2d(a + more, b, 4, 2, 1) for a, b in pairwise(_CHANNELS))
        nn.init.constant_(self.enlarging[-1].bias, _FIRST)  # type: ignore[arg-type]

    def forward(self, samples: StrokeSamples) -> Tensor:
        """Coverage of the samples' windows, [B, H, W]."""
        mirror = self.mirror(len(samples.path))
        numbers = numbers_of(samples.path, self.press, mirror)
        maps = self.linear(numbers.flatten(1)).unflatten(1, (_CHANNELS[0], *self.coarse))
        for number, layer in enumerate(self.enlarging, start=1):
            maps = layer(self._located(maps))
            if number < len(self.enlarging):
                maps = silu(maps)
        return place(unmirrored(torch.sigmoid(maps[:, 0]), mirror), self.crop, samples)

    def _located(self, maps: Tensor) -> Tensor:
        if not self.coordinates:
            return maps
        row, column = (torch.linspace(-1.0, 1.0, side) for side in maps.shape[2:])
        places = torch.stack(torch.meshgrid(row, column, indexing="ij"))
        return torch.cat([maps, places.expand(len(maps), -1, -1, -1)], dim=1)
