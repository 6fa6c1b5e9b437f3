"""A push model of particles: a graph network between particles of the surface and of the tool.

In the manner of RoboCraft (Shi et al. 2022): the clay is a set of particles, the tool is another, and a graph network
with messages along edges between neighbours predicts how particles move. This is a small version for height maps.
Each pixel of the map is a particle that moves up and down. The tool's particles lie on its path, so that one pass of
the network predicts a whole push. Places along edges are relative, in the frame of the push: the prediction moves with
the push and the slab by whole pixels, turns with them by quarter turns, and rises with the slab.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, grid_sample, pad, silu

from pentimento.dynamics.pushes.measured import PushSamples
from pentimento.dynamics.pushes.push_model import AutogradClay
from pentimento.dynamics.pushes.training import loss

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

SIDE_PX = 32
"""Side of the square of particles around the middle of the path. The others do not move."""
TOOL_PARTICLES = 6
HIDDEN = 24
SPACINGS = (1, 3)
"""Distance, in pixels, of the eight neighbours that a particle hears in each round of messages."""
RADIUS_M = 0.03
"""Tool particles farther than this from a particle, seen from above, do not act on it."""
_UNIT_M = 0.01
"""Unit of the lengths that the network sees."""
_OUT_M = 0.005
"""Unit of the change that it predicts."""
_AROUND = ((0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1))
"""Columns and rows (downwards) to the eight neighbours."""


@dataclass(frozen=True)
class ParticleTraining:
    """Hyper-parameters of the particle model."""

    epochs: int = 60
    batch: int = 16
    learning_rate: float = 0.006
    visual_weight: float = 1.0
    """Weight of the error in slope, mm², as of the project's model."""
    seed: int = 0


class Particles(NamedTuple):
    """Particles around B pushes, and the path of the tool from (0, 0, 0), in the unit of the network."""

    height: Tensor  # [B, S, S] above the surface at the start
    along: Tensor  # [B, S, S] in the direction of the push
    across: Tensor  # [B, S, S] to its left
    length: Tensor  # [B]
    depth: Tensor  # [B]
    heading: Tensor  # [B] rad, in the map

    def pick(self, index: Tensor) -> Particles:
        """The pushes with these indices."""
        return Particles(*(field[index] for field in self))


class ParticleNetwork(nn.Module):
    """The graph network. Untrained, it predicts no change."""

    def __init__(self) -> None:
        super().__init__()
        self.from_tool = nn.Linear(6, HIDDEN)
        self.heard = nn.Linear(2 * HIDDEN, HIDDEN)
        self.own = nn.ModuleList(nn.Linear(HIDDEN + 1, HIDDEN) for _ in SPACINGS)
        self.other = nn.ModuleList(nn.Linear(HIDDEN + 1, HIDDEN, bias=False) for _ in SPACINGS)
        self.way = nn.ModuleList(nn.Linear(2, HIDDEN, bias=False) for _ in SPACINGS)
        self.update = nn.ModuleList(nn.Linear(HIDDEN, HIDDEN) for _ in SPACINGS)
        self.out = nn.Linear(HIDDEN, 1)
        for parameter in self.out.parameters():
            nn.init.zeros_(parameter)

    def forward(self, seen: Particles, mirror: Tensor) -> Tensor:
        """Change of height [B, S, S] in metres; ``mirror`` [B] is 1, or -1 to see the push in a mirror."""
        across = mirror[:, None, None] * seen.across
        node, gate = self._from_tool(seen, across)
        cos, sin = torch.cos(seen.heading), torch.sin(seen.heading)
        for own, other, way, update, spacing in zip(self.own, self.other, self.way, self.update, SPACINGS, strict=True):
            known = torch.cat([node, seen.height[..., None]], -1)
            to_me, from_me = other(known), own(known)
            wide = pad(to_me.permute(0, 3, 1, 2), (spacing,) * 4, mode="replicate").permute(0, 2, 3, 1)
            heard = torch.zeros_like(node)
            for columns, rows in _AROUND:
                right, up = columns * 0.3 * spacing, -rows * 0.3 * spacing
                relative = torch.stack([cos * right + sin * up, mirror * (cos * up - sin * right)], -1)
                first_row, first_column = spacing * (1 + rows), spacing * (1 + columns)
                theirs = wide[:, first_row : first_row + SIDE_PX, first_column : first_column + SIDE_PX]
                heard = heard + silu(from_me + theirs + way(relative)[:, None, None, :])
            node = node + update(heard / len(_AROUND))
        return _OUT_M * gate * self.out(silu(node))[..., 0]

    def _from_tool(self, seen: Particles, across: Tensor) -> tuple[Tensor, Tensor]:
        """What particles [B, S, S] hear of the tool's particles [.., HIDDEN], and how near the tool passes, 0 to 1.

        An edge carries the relative place, the squared distance seen from above, how much higher the tool's particle
        is, its share of the path and its depth. With the squared distance, a sphere that touches a particle is a plane
        in these numbers. The first layer is linear in them, so it is taken apart into terms of either end.
        """
        weight, square = self.from_tool.weight.T, seen.along.square() + across.square()
        own = torch.stack([seen.along, across, square / 4, -seen.height], -1) @ weight[:4] + self.from_tool.bias
        of_both = (-seen.along * seen.length[:, None, None] / 2)[..., None] * weight[2]
        total = highest = gate = torch.zeros(())
        for number in range(TOOL_PARTICLES):
            share = number / (TOOL_PARTICLES - 1)
            travelled, low = share * seen.length[:, None], -share * seen.depth[:, None]
            theirs = -travelled * weight[0] + travelled.square() / 4 * weight[2] + low * (weight[3] + weight[5])
            theirs = theirs + share * weight[4]
            apart = square + (travelled.square() - 2 * travelled * seen.along.flatten(1)).view_as(square)
            near = (1 - apart / (RADIUS_M / _UNIT_M) ** 2).clamp(min=0).square()
            told = silu(own + share * of_both + theirs[:, None, None, :]) * near[..., None]
            total = total + told
            highest = told if number == 0 else torch.maximum(highest, told)
            gate = torch.maximum(gate, near)
        return silu(self.heard(torch.cat([total / TOOL_PARTICLES, highest], -1))), gate


def particles_around(height_m: Tensor, window_m: Tensor, action: Tensor) -> tuple[Particles, Tensor, Tensor]:
    """Particles around pushes [B, 5] on heights [B, H, W] over windows [B, 4], and their rows and columns [B, S].

    Rows and columns may lie beyond the map, whose edge is repeated there.
    """
    count, rows_px, columns_px = height_m.shape
    x_min, y_min, x_max, y_max = window_m.unbind(1)
    pixel_m = (x_max - x_min) / columns_px
    x, y, theta, length_m, depth_m = action.unbind(1)
    cos, sin = torch.cos(theta), torch.sin(theta)
    middle = torch.stack([(y_max - y - 0.5 * length_m * sin) / pixel_m, (x + 0.5 * length_m * cos - x_min) / pixel_m])
    first = torch.floor(middle.detach() - SIDE_PX / 2 + 0.5).long()
    rows, columns = first[..., None] + torch.arange(SIDE_PX)
    at = (
        torch.arange(count)[:, None, None],
        rows.clamp(0, rows_px - 1)[:, :, None],
        columns.clamp(0, columns_px - 1)[:, None],
    )
    right = x_min[:, None] + (columns + 0.5) * pixel_m[:, None] - x[:, None]
    up = y_max[:, None] - (rows + 0.5) * pixel_m[:, None] - y[:, None]
    turned = cos[:, None, None], sin[:, None, None]
    along = turned[0] * right[:, None, :] + turned[1] * up[:, :, None]
    across = turned[0] * up[:, :, None] - turned[1] * right[:, None, :]
    smooth = avg_pool2d(pad(height_m[:, None], (1, 1, 1, 1), mode="replicate"), 3, 1)
    place = torch.stack([2 * (x - x_min) / (x_max - x_min) - 1, 2 * (y_max - y) / (y_max - y_min) - 1], -1)
    surface = grid_sample(smooth, place[:, None, None], padding_mode="border", align_corners=False)[:, 0, 0, 0]
    height = height_m[at] - surface[:, None, None]
    lengths = (each / _UNIT_M for each in (height, along, across, length_m, depth_m))
    seen = Particles(*lengths, heading=theta)
    return seen, rows, columns


def moved(network: ParticleNetwork, height_m: Tensor, window_m: Tensor, action: Tensor) -> Tensor:
    """Heights [B, H, W] after pushes [B, 5] on heights [B, H, W] over windows [B, 4]."""
    seen, rows, columns = particles_around(height_m, window_m, action)
    change = network(seen, torch.ones(len(action)))
    count, rows_px, columns_px = height_m.shape
    inside = ((rows >= 0) & (rows < rows_px))[:, :, None] & ((columns >= 0) & (columns < columns_px))[:, None, :]
    batch = torch.arange(count)[:, None, None].expand_as(change)
    at = (
        batch,
        rows.clamp(0, rows_px - 1)[:, :, None].expand_as(change),
        columns.clamp(0, columns_px - 1)[:, None].expand_as(change),
    )
    return height_m.index_put(at, change * inside, accumulate=True)


def fit_particles(samples: PushSamples, config: ParticleTraining) -> ParticleNetwork:
    """Train on measured pushes, on the loss of the project's model, each push or its mirror image by chance."""
    torch.manual_seed(config.seed)
    network = ParticleNetwork()
    before, window, action, after = (
        torch.from_numpy(each.astype(np.float32))
        for each in (samples.before, samples.window_m, samples.action, samples.after)
    )
    seen, rows, columns = particles_around(before, window, action)
    rows_px, columns_px = before.shape[1:]
    at = (
        torch.arange(len(action))[:, None, None], rows.clamp(0, rows_px - 1)[:, :, None],
        columns.clamp(0, columns_px - 1)[:, None],
    )  # fmt: skip
    inside = ((rows >= 0) & (rows < rows_px))[:, :, None] & ((columns >= 0) & (columns < columns_px))[:, None, :]
    known, change = torch.from_numpy(samples.known)[at] & inside, (after - before)[at]
    optimizer = torch.optim.Adam(network.parameters(), lr=config.learning_rate)
    steps = config.epochs * -(-len(action) // config.batch)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    for _ in range(config.epochs):
        for some in torch.randperm(len(action)).split(config.batch):
            mirror = 2.0 * (torch.rand(len(some)) < 0.5).float() - 1
            predicted = network(seen.pick(some), mirror)
            optimizer.zero_grad()
            value = loss(
                predicted - change[some], known[some], samples.pixels_per_m, visual_weight=config.visual_weight
            )
            torch.autograd.backward(value)
            optimizer.step()
            schedule.step()
    return network.eval().requires_grad_(False)


class ParticleClay(AutogradClay):
    """The particle model over one window."""

    def __init__(self, network: ParticleNetwork, *, window_m: FloatArray, tool: str) -> None:
        super().__init__(window_m=window_m, tool=tool)
        self._network = network

    def heights(self, height: Tensor, action: Tensor) -> Tensor:
        """See ``AutogradClay``."""
        window = torch.tensor(self.window_m, dtype=torch.float32).expand(len(action), 4)
        return moved(self._network, height, window, action)
