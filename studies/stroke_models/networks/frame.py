"""The stroke's own frame: origin at the commanded start, +x towards the commanded end (thesis 5.3.2).

Networks draw a stroke's coverage in a crop of this frame; ``place`` lays it on the canvas as its path lies there.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import grid_sample

from pentimento.dynamics.strokes.samples import StrokeSamples

_NO_CHORD_M = 1e-6


class Frames(NamedTuple):
    """The frames of B strokes in the canvas frame."""

    start_m: Tensor  # [B, 2]
    along: Tensor  # [B, 2] unit vector from start to end; +x of the canvas where a path ends where it began

    def to_stroke(self, points_m: Tensor) -> Tensor:
        """Canvas points [B, ..., 2] in the strokes' frames."""
        lead = (-1,) + (1,) * (points_m.ndim - 2) + (2,)
        away, along = points_m - self.start_m.view(lead), self.along.view(lead)
        across = torch.stack([-along[..., 1], along[..., 0]], dim=-1)
        return torch.stack([(away * along).sum(-1), (away * across).sum(-1)], dim=-1)

    def to_canvas(self, points_m: Tensor) -> Tensor:
        """Points [B, ..., 2] of the strokes' frames on the canvas."""
        lead = (-1,) + (1,) * (points_m.ndim - 2) + (2,)
        along = self.along.view(lead)
        across = torch.stack([-along[..., 1], along[..., 0]], dim=-1)
        return self.start_m.view(lead) + points_m[..., :1] * along + points_m[..., 1:] * across


def frames_of(path: Tensor) -> Frames:
    """The frames of commanded paths [B, N, 5]."""
    start, chord = path[:, 0, 1:3], path[:, -1, 1:3] - path[:, 0, 1:3]
    length = chord.norm(dim=-1, keepdim=True)
    along = torch.where(length > _NO_CHORD_M, chord / length.clamp(min=_NO_CHORD_M), chord.new_tensor([1.0, 0.0]))
    return Frames(start, along)


def local_paths(path: Tensor) -> Tensor:
    """x and y of commanded paths [B, N, 5] in their own frames, [B, N, 2]."""
    return frames_of(path).to_stroke(path[..., 1:3])


class Crop(NamedTuple):
    """A part of the stroke's frame as an image, row 0 on the left side of the stroke; symmetric about its x axis."""

    left_m: float
    half_height_m: float
    height: int  # [px], even
    width: int  # [px]

    @property
    def pixels_per_m(self) -> float:
        """Resolution."""
        return self.height / (2 * self.half_height_m)

    def to_pixels(self, points_m: Tensor) -> Tensor:
        """Points [..., 2] of the stroke's frame to pixel coordinates (column, row)."""
        column = (points_m[..., 0] - self.left_m) * self.pixels_per_m - 0.5
        row = (self.half_height_m - points_m[..., 1]) * self.pixels_per_m - 0.5
        return torch.stack([column, row], dim=-1)

    def places_m(self) -> Tensor:
        """Where its pixels' centres lie in the stroke's frame, [height, width, 2]."""
        x = self.left_m + (torch.arange(self.width) + 0.5) / self.pixels_per_m
        y = self.half_height_m - (torch.arange(self.height) + 0.5) / self.pixels_per_m
        return torch.stack(torch.meshgrid(x, y, indexing="xy"), dim=-1)


def crop_around(path: Tensor, margin_m: float, pixels_per_m: float, multiple: int) -> Crop:
    """The smallest crop that holds commanded paths [B, N, 5] with a margin, its sides multiples of ``multiple`` px."""
    local = local_paths(path)
    low, high = float(local[..., 0].min()) - margin_m, float(local[..., 0].max()) + margin_m
    half = float(local[..., 1].abs().max()) + margin_m
    even = 2 * multiple if multiple % 2 else multiple
    height, width = (
        -(-int(side * pixels_per_m + 1) // step) * step for side, step in ((2 * half, even), (high - low, multiple))
    )
    return Crop(low, height / pixels_per_m / 2, height, width)


def places_of(samples: StrokeSamples) -> Tensor:
    """Where the centres of the windows' pixels lie in the strokes' frames, [B, H, W, 2]."""
    height, width = samples.valid.shape[1:]
    row, column = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    scale = samples.pixels_per_m[:, None, None]
    x = samples.top_left_m[:, 0, None, None] + (column + 0.5) / scale
    y = samples.top_left_m[:, 1, None, None] - (row + 0.5) / scale
    return frames_of(samples.path).to_stroke(torch.stack([x, y], dim=-1))


def place(drawn: Tensor, crop: Crop, samples: StrokeSamples, stretch: Tensor | None = None) -> Tensor:
    """Lay images [B, h, w] of the strokes' frames on the samples' windows: [B, H, W], 0 where the crop does not reach.

    ``stretch`` [B]: how much longer along x a stroke is than its image.
    """
    local = places_of(samples)
    if stretch is not None:
        local = local / torch.stack([stretch, torch.ones_like(stretch)], dim=-1)[:, None, None]
    return _sampled(drawn, crop.to_pixels(local))


def cut(images: Tensor, crop: Crop, samples: StrokeSamples, stretch: Tensor | None = None) -> Tensor:
    """The other way: what images [B, H, W] of the samples' windows show in the strokes' frames, [B, h, w]."""
    local = crop.places_m()[None].expand(len(images), -1, -1, -1)
    if stretch is not None:
        local = local * torch.stack([stretch, torch.ones_like(stretch)], dim=-1)[:, None, None]
    return _sampled(images, samples.view.to_pixels(frames_of(samples.path).to_canvas(local)))


def _sampled(images: Tensor, at_px: Tensor) -> Tensor:
    """Bilinear values of images [B, H, W] at pixel coordinates [B, h, w, 2] (column, row); 0 outside."""
    size = at_px.new_tensor([images.shape[2], images.shape[1]])
    return grid_sample(images[:, None], (2 * at_px + 1) / size - 1, align_corners=False)[:, 0]
