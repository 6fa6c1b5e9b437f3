"""A U-Net that predicts a push in the scan's own frame, without turning it into the push's pose.

It sees the map around the pixel where the push starts, and as further channels the place of each pixel relative to the
start, the direction, the length and the depth. Training turns and mirrors the pushes at random, so that a direction is
seen in all eight positions of the square.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from pentimento.dynamics.pushes.measured import PushSamples
from pentimento.dynamics.pushes.pose import gradient
from pentimento.dynamics.pushes.training import TrainingConfig, loss
from studies.stroke_models.networks.unet import UNet

SIDE_PX = 96
"""Side of the square around the start: the longest push in any direction, and what it displaces."""
CHANNELS = 9
"""Height, two slopes, two coordinates, two components of the direction, length and depth."""
_HEIGHT_MM, _PLACE_MM, _LENGTH_MM, _DEPTH_MM = 5.0, 25.0, 20.0, 5.0
"""Units of what the network sees: those of ``Param2Deform``."""
_MAX_HEIGHT = 4.0
"""Heights are clipped at this many units."""
_BATCH = 64
"""Pushes in one forward pass."""


class MapPushes(NamedTuple):
    """N pushes in squares of the scan around their starts, heights in metres; row 0 is at the top."""

    state: Tensor  # [N, side, side] before, above the surface at the start
    change: Tensor  # [N, side, side] after - before
    known: Tensor  # [N, side, side] bool
    start_m: Tensor  # [N, 2] x and y of the start from the middle of the square
    heading: Tensor  # [N, 2] x and y of the direction, unit length
    length_m: Tensor  # [N]
    depth_m: Tensor  # [N]

    def pick(self, index: Tensor) -> MapPushes:
        """The pushes with these indices."""
        return MapPushes(*(field[index] for field in self))

    def turned(self, flip: Tensor, swap: Tensor) -> MapPushes:
        """The same pushes mirrored at the vertical and the horizontal axis where ``flip`` [N, 2] is true, then at the
        diagonal from top left to bottom right where ``swap`` [N] is."""
        images = list(self[:3])
        for axis, image_axis in ((0, 2), (1, 1)):
            mirrored = flip[:, axis, None, None]
            images = [torch.where(mirrored, image.flip(image_axis), image) for image in images]
        images = [torch.where(swap[:, None, None], image.transpose(1, 2), image) for image in images]
        sign = 1.0 - 2.0 * flip.float()
        vectors = [torch.where(swap[:, None], -(sign * v).flip(1), sign * v) for v in (self.start_m, self.heading)]
        return MapPushes(images[0], images[1], images[2], vectors[0], vectors[1], self.length_m, self.depth_m)


def in_map(samples: PushSamples) -> MapPushes:
    """Measured pushes in squares of the scan; beyond the scan the edge is repeated and unknown."""
    count, height, width = samples.before.shape
    row, column = _first_pixels(samples)
    rows, columns = (first[:, None] + np.arange(SIDE_PX) for first in (row, column))
    inside = ((rows >= 0) & (rows < height))[:, :, None] & ((columns >= 0) & (columns < width))[:, None, :]
    at = np.arange(count)[:, None, None], rows.clip(0, height - 1)[:, :, None], columns.clip(0, width - 1)[:, None, :]
    before, after = samples.before[at], samples.after[at]
    middle = np.stack([column, row], axis=1) + SIDE_PX / 2
    start_m = (_start_pixels(samples) - middle) / samples.pixels_per_m * [1.0, -1.0]
    theta, length_m, depth_m = samples.action[:, 2:].T
    numbers = (start_m, np.stack([np.cos(theta), np.sin(theta)], axis=1), length_m, depth_m)
    return MapPushes(
        torch.from_numpy(before - samples.surface_m.astype(np.float32)[:, None, None]),
        torch.from_numpy(after - before),
        torch.from_numpy(samples.known[at] & inside),
        *(torch.from_numpy(number.astype(np.float32)) for number in numbers),
    )


def channels(pushes: MapPushes, pixels_per_m: float) -> Tensor:
    """What the network sees, [N, CHANNELS, side, side]."""
    height = (1e3 * pushes.state / _HEIGHT_MM).clamp(-_MAX_HEIGHT, _MAX_HEIGHT)
    steps = (torch.arange(SIDE_PX) + 0.5 - SIDE_PX / 2) / pixels_per_m
    place_m = torch.stack(torch.meshgrid(steps, -steps, indexing="xy")) - pushes.start_m[:, :, None, None]
    lengths = torch.stack([1e3 * pushes.length_m / _LENGTH_MM, 1e3 * pushes.depth_m / _DEPTH_MM], dim=1)
    numbers = torch.cat([pushes.heading, lengths], dim=1)[:, :, None, None].expand(-1, -1, SIDE_PX, SIDE_PX)
    slopes = pixels_per_m * gradient(pushes.state)
    return torch.cat([height[:, None], slopes, 1e3 * place_m / _PLACE_MM, numbers], dim=1)


def fit_unet(training: PushSamples, config: TrainingConfig) -> UNet:
    """Train on the loss, the schedule and the number of pushes of ``config``."""
    pushes, pixels_per_m = in_map(training), training.pixels_per_m
    torch.manual_seed(config.seed)
    network = UNet(CHANNELS)
    optimizer = torch.optim.Adam(network.parameters(), lr=config.learning_rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, config.epochs)
    generator = torch.Generator().manual_seed(config.seed)
    for _ in range(config.epochs):
        for index in torch.randperm(len(pushes.state), generator=generator).split(config.batch):
            turn = torch.rand(len(index), 3, generator=generator) < 0.5
            some = pushes.pick(index).turned(turn[:, :2], turn[:, 2])
            optimizer.zero_grad()
            change = 1e-3 * network(channels(some, pixels_per_m))
            difference = change - some.change
            torch.autograd.backward(loss(difference, some.known, pixels_per_m, visual_weight=config.visual_weight))
            optimizer.step()
        schedule.step()
    return network.eval()


def after_unet(network: UNet, samples: PushSamples) -> Tensor:
    """Heights [N, H, W] after each push, over the whole window, metres."""
    pushes = in_map(samples)
    with torch.no_grad():
        parts = torch.arange(len(pushes.state)).split(_BATCH)
        change = torch.cat([1e-3 * network(channels(pushes.pick(part), samples.pixels_per_m)) for part in parts])
    return torch.from_numpy(samples.before) + on_map(change, samples)


def on_map(change: Tensor, samples: PushSamples) -> Tensor:
    """Changes [N, side, side] in the squares of the pushes, on whole scans [N, H, W]; 0 beyond the squares."""
    _, height, width = samples.before.shape
    result = torch.zeros(samples.before.shape)
    for number, (row, column) in enumerate(zip(*_first_pixels(samples), strict=True)):
        top, left = max(row, 0), max(column, 0)
        bottom, right = min(row + SIDE_PX, height), min(column + SIDE_PX, width)
        part = change[number, top - row : bottom - row, left - column : right - column]
        result[number, top:bottom, left:right] = part
    return result


def _start_pixels(samples: PushSamples) -> np.ndarray:
    """[N, 2] column and row of the starts, from the outer corner of the first pixel."""
    x_min, _, _, y_max = samples.window_m.T
    return np.stack([samples.action[:, 0] - x_min, y_max - samples.action[:, 1]], axis=1) * samples.pixels_per_m


def _first_pixels(samples: PushSamples) -> tuple[np.ndarray, np.ndarray]:
    """Row and column [N] of the first pixel of each square; outside the scan they are negative."""
    column, row = np.rint(_start_pixels(samples)).astype(np.int64).T - SIDE_PX // 2
    return row, column
