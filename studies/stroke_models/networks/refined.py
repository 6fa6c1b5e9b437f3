"""Traj2Stroke with a U-Net behind it (thesis 5.4.3), for what its numbers cannot say: texture, bristle drag."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from pentimento.dynamics.strokes.samples import StrokeSamples
from pentimento.dynamics.strokes.traj2stroke import Mark, Traj2Stroke
from studies.stroke_models.networks.coverage import CoverageModel, drawn, unmirrored
from studies.stroke_models.networks.frame import crop_around, frames_of, place
from studies.stroke_models.networks.unet import COARSER, UNet


class RefinedTraj2Stroke(CoverageModel):
    """Untrained, it predicts what its Traj2Stroke does: the U-Net's last convolution is zero."""

    def __init__(self, base: Traj2Stroke, margin_m: float, pixels_per_m: float) -> None:
        super().__init__()
        self.base, self.retouch = base, Retouch(margin_m, pixels_per_m)

    def forward(self, samples: StrokeSamples) -> Tensor:
        """Coverage of the samples' windows, [B, H, W]."""
        mark = self.base(samples.path)
        scale = samples.pixels_per_m[:, None]
        size = (samples.valid.shape[1], samples.valid.shape[2])
        there = drawn(samples.view.to_pixels(mark.points_m), mark.radius_m * scale, mark.density, mark.softness, size)
        return (there + self.retouch(mark, samples, self.mirror(len(mark.radius_m)))).clamp(0.0, 1.0)


class Retouch(nn.Module):
    """What a U-Net adds to a mark's coverage or takes away.

    It sees the mark in the stroke's own frame, so that what trails behind the tool lies on one side; its answer is laid
    on the canvas, where marks are drawn without resampling.
    """

    def __init__(self, margin_m: float, pixels_per_m: float) -> None:
        super().__init__()
        self.net = UNet(1)
        self.margin_m, self.pixels_per_m = margin_m, pixels_per_m

    def forward(self, mark: Mark, samples: StrokeSamples, mirror: Tensor) -> Tensor:
        """Coverage more or less in the samples' windows, [B, H, W], for marks [B, N]; ``mirror`` [B]."""
        crop = crop_around(samples.path, self.margin_m, self.pixels_per_m, COARSER)
        local = frames_of(samples.path).to_stroke(mark.points_m)
        local = torch.stack([local[..., 0], local[..., 1] * mirror[:, None]], dim=-1)
        radius = mark.radius_m * crop.pixels_per_m
        seen = drawn(crop.to_pixels(local), radius, mark.density, mark.softness, (crop.height, crop.width))
        return place(unmirrored(self.net(seen[:, None]), mirror), crop, samples)
