"""Height maps and samples in a push's constant pose (thesis 7.3.4), and losses on them.

In the constant pose, the push starts at one place and moves in +x. A height map of the canvas is sampled bilinearly on
the pixels of a square in the push's frame. A change predicted there is sampled on the canvas's pixels. Both directions
are differentiable in the image and in x, y, theta.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import grid_sample, pad

from pentimento.contracts.ranges import above_zero, at_least
from pentimento.dynamics.pushes.measured import PushSamples

_MIN_KNOWN_WEIGHT = 0.99
"""Minimum share of the interpolation weights of a crop pixel that must come from measured pixels."""


@dataclass(frozen=True)
class Crop:
    """The square of the constant pose. Row 0 is to the left of the push (its +y), columns go along it."""

    side_px: int
    pixels_per_m: float
    behind_m: float
    """Extent of the square behind the start."""

    def __post_init__(self) -> None:
        at_least(self, 8, "side_px")
        above_zero(self, "pixels_per_m", "behind_m")
        if self.behind_m >= self.side_px / self.pixels_per_m:
            raise ValueError(f"behind_m is {self.behind_m} m; the start must lie in the square.")

    def places_m(self) -> Tensor:
        """[side, side, 2] x (along) and y (to the left) of each pixel's centre in the push's frame."""
        steps = (torch.arange(self.side_px, dtype=torch.float32) + 0.5) / self.pixels_per_m
        along, across = steps - self.behind_m, self.side_px / self.pixels_per_m / 2 - steps
        return torch.stack(torch.meshgrid(along, across, indexing="xy"), dim=-1)


def to_pose(image: Tensor, window_m: Tensor, action: Tensor, crop: Crop) -> Tensor:
    """Crop of each action from an image, with edge padding.

    Args:
        image: [B, H, W]; window_m: [B, 4]; action: [B, >=3] x_m, y_m, theta_rad, ...

    Returns:
        [B, side, side].
    """
    grid = _in_image(window_m, action, crop)
    return grid_sample(image[:, None], grid, padding_mode="border", align_corners=False)[:, 0]


def within(window_m: Tensor, action: Tensor, crop: Crop) -> Tensor:
    """Which pixels of each action's crop lie in its window: bool [B, side, side]."""
    return (_in_image(window_m, action, crop).abs() <= 1).all(-1)


def to_canvas(change: Tensor, window_m: Tensor, action: Tensor, *, shape: tuple[int, int], crop: Crop) -> Tensor:
    """A change [B, side, side] in the crops of actions, on the canvas's pixels [B, H, W]; 0 beyond the crops."""
    height, width = shape
    x_min, y_min, x_max, y_max = window_m[:, :, None, None].unbind(1)
    column = (torch.arange(width, dtype=change.dtype, device=change.device) + 0.5) / width
    row = (torch.arange(height, dtype=change.dtype, device=change.device)[:, None] + 0.5) / height
    x = x_min + (x_max - x_min) * column - action[:, 0, None, None]
    y = y_max - (y_max - y_min) * row - action[:, 1, None, None]
    cos, sin = torch.cos(action[:, 2, None, None]), torch.sin(action[:, 2, None, None])
    along, across = cos * x + sin * y, cos * y - sin * x
    side_m = crop.side_px / crop.pixels_per_m
    grid = torch.stack([2 * (along + crop.behind_m) / side_m - 1, -2 * across / side_m], dim=-1)
    return grid_sample(change[:, None], grid, padding_mode="zeros", align_corners=False)[:, 0]


def _in_image(window_m: Tensor, action: Tensor, crop: Crop) -> Tensor:
    """[B, side, side, 2] place of each pixel of the crop in the image, from -1 to 1 across and down."""
    x, y = _turned(crop.places_m().to(action), action[:, 2]) + action[:, :2].T[..., None, None]
    x_min, y_min, x_max, y_max = window_m[:, :, None, None].unbind(1)
    return torch.stack([2 * (x - x_min) / (x_max - x_min) - 1, 2 * (y_max - y) / (y_max - y_min) - 1], dim=-1)


def _turned(places_m: Tensor, theta_rad: Tensor) -> Tensor:
    """[2, B, side, side]: places of the push's frame, rotated by theta [B]."""
    cos, sin = torch.cos(theta_rad)[:, None, None], torch.sin(theta_rad)[:, None, None]
    along, across = places_m.unbind(-1)
    return torch.stack([cos * along - sin * across, sin * along + cos * across])


class PoseSamples(NamedTuple):
    """N pushes in the constant pose, heights in metres."""

    state: Tensor  # [N, side, side] before
    change: Tensor  # [N, side, side] after - before
    known: Tensor  # [N, side, side] bool
    length_m: Tensor  # [N]
    depth_m: Tensor  # [N]
    context: Tensor  # [N] int64

    def pick(self, index: Tensor) -> PoseSamples:
        """The samples with these indices."""
        return PoseSamples(*(field[index] for field in self))

    def mirrored(self, mirror: Tensor) -> PoseSamples:
        """The same pushes mirrored at the line of travel where ``mirror`` [N] is true."""
        images = [torch.where(mirror[:, None, None], image.flip(1), image) for image in self[:3]]
        return PoseSamples(images[0], images[1], images[2], *self[3:])


def in_pose(samples: PushSamples, crop: Crop, context: int = 0) -> PoseSamples:
    """Measured pushes in the constant pose, all of one context."""
    window, action = (torch.from_numpy(array.astype(np.float32)) for array in (samples.window_m, samples.action))
    before, after, known = (
        to_pose(torch.from_numpy(image.astype(np.float32)), window, action, crop)
        for image in (samples.before, samples.after, samples.known)
    )
    inside = within(window, action, crop)
    return PoseSamples(
        before,
        after - before,
        (known > _MIN_KNOWN_WEIGHT) & inside,
        action[:, 3],
        action[:, 4],
        torch.full((len(action),), context),
    )


def gradient(image: Tensor) -> Tensor:
    """[B, H, W] to [B, 2, H, W]: central differences along columns and rows, per pixel; the edge is replicated."""
    wide = pad(image[:, None], (1, 1, 1, 1), mode="replicate")[:, 0]
    across = (wide[:, 1:-1, 2:] - wide[:, 1:-1, :-2]) / 2
    down = (wide[:, 2:, 1:-1] - wide[:, :-2, 1:-1]) / 2
    return torch.stack([across, down], dim=1)


def inner(known: Tensor) -> Tensor:
    """[B, H, W]: which of the known pixels have four known neighbours, so that their gradient is known."""
    wide = pad(known, (1, 1, 1, 1))
    middle = wide[:, 1:-1, 1:-1]
    return middle & wide[:, :-2, 1:-1] & wide[:, 2:, 1:-1] & wide[:, 1:-1, :-2] & wide[:, 1:-1, 2:]


def height_errors(difference_m: Tensor, known: Tensor) -> Tensor:
    """L_3D (thesis 7.1) of each of [B, H, W] differences: mean square over the known pixels, mm²."""
    weight = known.to(difference_m.dtype)
    return (1e3 * difference_m).square().mul(weight).sum((1, 2)) / weight.sum((1, 2)).clamp(min=1.0)


def slope_errors(difference_m: Tensor, known: Tensor, pixels_per_m: float) -> Tensor:
    """L_viz (thesis 7.2) of each of [B, H, W] differences: mean square of the gradient, dimensionless (m/m).

    Only pixels whose gradient is known count.
    """
    weight = inner(known).to(difference_m.dtype)
    steep = (pixels_per_m * gradient(difference_m)).square().sum(1)
    return (steep * weight).sum((1, 2)) / weight.sum((1, 2)).clamp(min=1.0)
