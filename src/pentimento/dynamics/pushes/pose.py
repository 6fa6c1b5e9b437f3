"""Between the canvas and a push's constant pose: the push starts at one place and moves in +x (thesis 7.3.4).

A height map of the canvas is sampled bilinearly on the pixels of a square that stands in the push's frame, and a change
that was foretold there is sampled on the canvas's pixels. Both ways are differentiable in the image and in x, y, theta.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import grid_sample

from pentimento.contracts.ranges import above_zero, at_least


@dataclass(frozen=True)
class Crop:
    """The square of the constant pose: row 0 is to the left of the push (its +y), columns go along it."""

    side_px: int
    pixels_per_m: float
    behind_m: float
    """How much of the square lies behind the start."""

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
    """What the crop of each action sees of an image; beyond the image's edge, the edge.

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


def to_canvas(change: Tensor, window_m: Tensor, action: Tensor, shape: tuple[int, int], crop: Crop) -> Tensor:
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
    """[B, side, side, 2] where each pixel of the crop is in the image, from -1 to 1 across and down it."""
    x, y = _turned(crop.places_m().to(action), action[:, 2]) + action[:, :2].T[..., None, None]
    x_min, y_min, x_max, y_max = window_m[:, :, None, None].unbind(1)
    return torch.stack([2 * (x - x_min) / (x_max - x_min) - 1, 2 * (y_max - y) / (y_max - y_min) - 1], dim=-1)


def _turned(places_m: Tensor, theta_rad: Tensor) -> Tensor:
    """[2, B, side, side]: places of the push's frame turned by theta [B]."""
    cos, sin = torch.cos(theta_rad)[:, None, None], torch.sin(theta_rad)[:, None, None]
    along, across = places_m.unbind(-1)
    return torch.stack([cos * along - sin * across, sin * along + cos * across])
