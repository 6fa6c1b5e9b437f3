"""A U-Net on a picture of the commanded path: no part of the thesis, and the strongest rival that is a network alone.

The thesis's CNNs must learn where a number lies in a picture (5.4.3). This one is spared that: its input is the path,
drawn as a thin line in the stroke's frame, with the press and how far the tip has come as further channels.
"""

from __future__ import annotations

import torch
from torch import Tensor

from pentimento.dynamics.strokes.samples import StrokeSamples
from studies.stroke_models.networks.coverage import CoverageModel, PressRange, drawn, unmirrored
from studies.stroke_models.networks.frame import crop_around, local_paths, place
from studies.stroke_models.networks.unet import COARSER, UNet

_LINE_PX, _EDGE = 1.5, 0.3
_OPACITY = 0.8
"""Of the line that it starts from: at 1, the clamp would hide from it that paint is paler."""


class PathImageCnn(CoverageModel):
    """Pictures of paths to coverage. Untrained, it predicts the line: from blank paper, L1 has no useful gradient."""

    def __init__(self, press: PressRange, margin_m: float, pixels_per_m: float) -> None:
        super().__init__()
        self.press, self.net = press, UNet(3)
        self.margin_m, self.pixels_per_m = margin_m, pixels_per_m

    def forward(self, samples: StrokeSamples) -> Tensor:
        """Coverage of the samples' windows, [B, H, W]."""
        crop = crop_around(samples.path, self.margin_m, self.pixels_per_m, COARSER)
        mirror = self.mirror(len(samples.path))
        local = local_paths(samples.path)
        at = crop.to_pixels(torch.stack([local[..., 0], local[..., 1] * mirror[:, None]], dim=-1))
        line = torch.ones_like(at[..., 0])
        press = 0.1 + 0.8 * self.press.share(samples.path).clamp(0.0, 1.0)
        come = torch.linspace(0.1, 0.9, at.shape[1]).expand_as(line)
        size = (crop.height, crop.width)
        images = [drawn(at, _LINE_PX * line, value, _EDGE * line, size) for value in (line, press, come)]
        covered = (_OPACITY * images[0] + self.net(torch.stack(images, dim=1))).clamp(0.0, 1.0)
        return place(unmirrored(covered, mirror), crop, samples)
