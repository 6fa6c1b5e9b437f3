"""What all networks share: they predict a stroke's coverage of the paper, [B, H, W] in [0, 1]."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import torch
from torch import Tensor, nn

from pentimento.dynamics.strokes.autograd import render_strokes
from pentimento.dynamics.strokes.photometry import linear_to_srgb, srgb_to_linear
from pentimento.dynamics.strokes.samples import StrokeSamples, inked_share
from pentimento.render import PixelStrokes
from studies.stroke_models.networks.frame import local_paths

_UNIT_M = 0.02
"""Positions go into networks in such units."""


def laid(coverage: Tensor, samples: StrokeSamples) -> Tensor:
    """The photograph after each stroke, sRGB [B, H, W, 3], from its coverage [B, H, W]; mixed in linear light."""
    below, paint = samples.before_linear, srgb_to_linear(samples.color)[:, None, None]
    return linear_to_srgb(below + coverage[..., None] * (paint - below))


def measured_coverage(samples: StrokeSamples) -> Tensor:
    """What photographs say of it, [B, H, W] in [0, 1]: the share of the way from paper to paint, linear light."""
    paint = srgb_to_linear(samples.color)[:, None, None]
    return inked_share(samples.before_linear, srgb_to_linear(samples.after), paint).clamp(0.0, 1.0)


def drawn(points_px: Tensor, radius_px: Tensor, density: Tensor, softness: Tensor, size: tuple[int, int]) -> Tensor:
    """Coverage [B, height, width] of strokes: points [B, N, 2], the others [B, N], as the renderer draws them."""
    ground = points_px.new_zeros(len(points_px), *size, 3)
    white = points_px.new_ones(len(points_px), 3)
    strokes = PixelStrokes(points_px, radius_px, density, softness, white).at((slice(None), None))
    return render_strokes(strokes, ground)[..., 0]


class PressRange(NamedTuple):
    """Lightest and deepest press of the strokes that are learnt from, metres."""

    low_m: float
    high_m: float

    def share(self, path: Tensor) -> Tensor:
        """Press along paths [B, N, 5], about 0 to 1, [B, N]; 0.5 where no stroke pressed otherwise."""
        width = self.high_m - self.low_m
        press = (-path[..., 3]).clamp(min=0.0)
        return (press - self.low_m) / width if width > 0 else torch.full_like(press, 0.5)


def press_range(path: Tensor) -> PressRange:
    """Of commanded paths [B, N, 5]."""
    press = (-path[..., 3]).clamp(min=0.0)
    return PressRange(float(press.min()), float(press.max()))


class CoverageModel(nn.Module):
    """A model of coverage; in training it sees half of the strokes in a mirror that holds their x axis."""

    draws_from_numbers: ClassVar[bool] = False
    """Whether it must learn where in a picture a number lies (thesis 5.4.3)."""

    def forward(self, samples: StrokeSamples) -> Tensor:
        """Coverage of the samples' windows, [B, H, W]."""
        raise NotImplementedError

    def mirror(self, strokes: int) -> Tensor:
        """See ``mirrors``."""
        return mirrors(strokes, self.training)


def mirrors(strokes: int, training: bool) -> Tensor:
    """[B] +1, or -1 for a stroke that is seen in the mirror: in training, half of them."""
    return torch.randint(0, 2, (strokes,)).float() * 2 - 1 if training else torch.ones(strokes)


def unmirrored(images: Tensor, mirror: Tensor) -> Tensor:
    """Images [B, h, w] of crops, turned back where they were drawn in the mirror [B]."""
    return torch.where(mirror[:, None, None] < 0, images.flip(1), images)


def numbers_of(path: Tensor, press: PressRange, mirror: Tensor) -> Tensor:
    """Commanded paths as a network sees them, [B, N, 3]: x and y in their own frame, press."""
    local = local_paths(path) / _UNIT_M
    return torch.stack([local[..., 0], local[..., 1] * mirror[:, None], press.share(path) - 0.5], dim=-1)
