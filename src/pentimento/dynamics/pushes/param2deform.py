"""param2deform (thesis 7.3.4): change of height from the clay before a push, its length and its depth.

Everything is in the constant pose: the push starts at one place and moves in +x. Besides the thesis's inputs, the
network sees where the tool's underside cuts into the surface. That swept volume explains most of the change with few
parameters. The network works on blocks of 2 × 2 pixels as channels, at a quarter of the cost. Each context (a pair of
material and tool in the training set) has its own tool parameters, and its own embedding in addition to the length and
the depth.

The tool travels along +x of its frame and sinks on a line from the surface to its depth (thesis 7.3.2). Its underside
rises from the tip as a power of the distance, which covers a ball (power 2), a tip and a flat face. Its reach along and
across, the power and the sinking are fitted. The swept volume has no published source.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate, pixel_shuffle, pixel_unshuffle, silu

from pentimento.dynamics.pushes.pose import Crop, gradient

CONTEXT = 8
"""Size of a context's embedding."""
_TOOL = 5
"""Parameters of a tool's underside; see ``Param2Deform.tool``."""
_FIRST_REACH_MM = 8.0
"""Reach of the underside before any fit."""
_FIRST_APART_MM = 25.0
"""Distance of each finger of a pinch from the middle before any fit."""
_SCALE_MM = 5.0
"""Unit of the heights that the network sees."""
_MAX_HEIGHT = 4.0
"""Heights relative to the start are clipped at this many units."""
_START_MM = 3.0
"""Radius of the median around the start, as in ``contracts.height_maps.surface_at_m``."""
_COARSE = 8
"""Side of the maps that length and depth are expanded to."""
_MAPS = 4
"""Number of these maps."""
_SHAPE = 8
"""Channels of the branch of length and depth."""
_MERGED = 24
"""Channels after merging."""
_MIN_TRAVEL_MM = 0.05  # a travel of no length is a tool pressed straight down
"""Added to the travel, so that a push without travel is a tool pressed straight down."""
_TINY = 1e-6
"""Avoids the logarithm of zero."""
_REACHES = 3.0
"""The underside is evaluated at most this many reaches away from a place."""


class Param2Deform(nn.Module):
    """The network. Untrained, it predicts no change."""

    x_mm: Tensor
    y_mm: Tensor
    place: Tensor
    fade: Tensor
    start: Tensor
    finer: Tensor

    def __init__(self, crop: Crop, channels: int, contexts: int = 1, pinches: bool = False) -> None:
        """``channels`` are those of the state's branch; the crop's side must be even.

        A pinch is placed midway between the fingers. Both close towards it along x, by half the length each.
        """
        super().__init__()
        if crop.side_px % 2:
            raise ValueError(f"The crop's side is {crop.side_px} pixels; it must be even.")
        self.tool = nn.Parameter(torch.zeros(contexts, _TOOL))
        """[C, 5]: logarithms of the underside's two reaches over 8 mm, of its power - 1 and of its sinking; share of
        the dent that stays."""
        self.context = nn.Parameter(torch.zeros(contexts, CONTEXT))
        self.apart = nn.Parameter(torch.zeros(contexts)) if pinches else None
        """[C]: logarithm of each finger's first distance from the middle, over 25 mm; None for pushes."""
        self.shape = nn.Sequential(
            nn.Linear(2 + CONTEXT, 32), nn.SiLU(), nn.Linear(32, 32), nn.SiLU(), nn.Linear(32, _MAPS * _COARSE**2)
        )
        self.shape_maps = _convolutions(_MAPS, _SHAPE, _SHAPE, _SHAPE)
        self.state_maps = _convolutions(3 * 4, channels, channels, channels)
        # state features, state, shape's maps, clearance, dent, place
        merged = channels + 4 + _SHAPE + 4 + 4 + 2
        self.merged = _convolutions(merged, _MERGED, _MERGED, _MERGED, _MERGED, 4)
        for parameter in self.merged[-1].parameters():
            nn.init.zeros_(parameter)
        x_mm, y_mm = (1e3 * crop.places_m()).unbind(-1)
        self.register_buffer("x_mm", x_mm, persistent=False)
        self.register_buffer("y_mm", y_mm, persistent=False)
        self.register_buffer("place", _coarse(torch.stack([x_mm, y_mm])[None]) / 25.0, persistent=False)
        self.register_buffer("fade", _fade(crop.side_px), persistent=False)
        near = torch.hypot(x_mm, y_mm) <= max(_START_MM, 0.75e3 / crop.pixels_per_m)
        self.register_buffer("start", near.flatten().nonzero()[:, 0], persistent=False)
        self.register_buffer("finer", _interpolation(crop.side_px // 2, _COARSE), persistent=False)
        self.pixel_mm = 1e3 / crop.pixels_per_m

    def forward(self, state_m: Tensor, length_m: Tensor, depth_m: Tensor, context: Tensor) -> Tensor:
        """Change of height [B, side, side] in metres.

        Args:
            state_m: [B, side, side] height of the crop; its zero is arbitrary.
            length_m, depth_m: [B].
            context: int64 [B].
        """
        return self.change(*self.features(state_m, length_m, depth_m, context), context)

    @property
    def last_layer(self) -> nn.Conv2d:
        """The convolution that follows the features."""
        layer = self.merged[-1]
        assert isinstance(layer, nn.Conv2d)
        return layer

    def features(self, state_m: Tensor, length_m: Tensor, depth_m: Tensor, context: Tensor) -> tuple[Tensor, Tensor]:
        """What the last layer and the tool's share of the dent are applied to: the dent [B, side, side] in mm, and
        features [B, F, side/2, side/2]. See ``forward``."""
        state = 1e3 * (state_m - self.at_start(state_m)[:, None, None])
        dent, clearance = self._dent(state, length_m, depth_m, context)
        height = (state / _SCALE_MM).clamp(-_MAX_HEIGHT, _MAX_HEIGHT)
        steep = gradient(state / self.pixel_mm)
        seen = _blocks(torch.cat([height[:, None], steep], dim=1))
        heights = seen[:, :4]
        numbers = torch.stack([1e3 * length_m / 20.0, 1e3 * depth_m / 5.0], dim=1)
        coarse = self.shape(torch.cat([numbers, self.context[context]], dim=1)).reshape(-1, _MAPS, _COARSE, _COARSE)
        fine = self.finer @ coarse @ self.finer.T
        features = [
            _chain(self.state_maps, seen), heights, _chain(self.shape_maps, fine),
            _blocks(clearance[:, None] / _SCALE_MM), _blocks(dent[:, None] / _SCALE_MM),
            self.place.expand(state.shape[0], -1, -1, -1),
        ]  # fmt: skip
        return dent, _chain(list(self.merged)[:-1], torch.cat(features, dim=1))

    def change(self, dent_mm: Tensor, features: Tensor, context: Tensor) -> Tensor:
        """Change of height [B, side, side] in metres from the dent and the features."""
        residual = pixel_shuffle(self.last_layer(features), 2)[:, 0]
        change_mm = self.tool[context, 4][:, None, None] * dent_mm + residual
        return 1e-3 * self.fade * change_mm

    def pressed(self, state_m: Tensor, length_m: Tensor, depth_m: Tensor, context: Tensor) -> Tensor:
        """Change of height predicted by the tool's geometry alone, without the network: [B, side, side] in metres."""
        state = 1e3 * (state_m - self.at_start(state_m)[:, None, None])
        dent, _ = self._dent(state, length_m, depth_m, context)
        return 1e-3 * self.fade * self.tool[context, 4][:, None, None] * dent

    def at_start(self, state_m: Tensor) -> Tensor:
        """[B]: height at the start of the push, from which its depth counts: the median around it.

        Its gradient is that of the mean, to which all pixels there contribute.
        """
        near = state_m.flatten(1)[:, self.start]
        mean = near.mean(1)
        return mean + (near.detach().sort(dim=1).values[:, near.shape[1] // 2] - mean.detach())

    def _dent(self, state_mm: Tensor, length_m: Tensor, depth_m: Tensor, context: Tensor) -> tuple[Tensor, Tensor]:
        """The tool's swept volume, in mm: how deep it cuts into the surface (≤ 0), and its clearance (bounded)."""
        numbers = self.tool[context]
        reach = _FIRST_REACH_MM * numbers[:, :2].clamp(-2.0, 2.0).exp()
        underside = Underside(
            reach[:, 0], reach[:, 1], 1 + numbers[:, 2].clamp(-1.5, 2.0).exp(), numbers[:, 3].clamp(-1.0, 1.0).exp()
        )
        if self.apart is None:
            lowest = clearance_mm(
                self.x_mm, self.y_mm, length_mm=1e3 * length_m, depth_mm=1e3 * depth_m, tool=underside
            )
        else:
            apart = _FIRST_APART_MM * self.apart[context].clamp(-1.0, 1.0).exp()[:, None, None]
            left = clearance_mm(
                self.x_mm + apart, self.y_mm, length_mm=500.0 * length_m, depth_mm=1e3 * depth_m, tool=underside
            )
            lowest = torch.minimum(left, left.flip(2))
        clearance = (lowest - state_mm).clamp(-_MAX_HEIGHT * _SCALE_MM, 2 * _SCALE_MM)
        return clearance.clamp(max=0.0), clearance


def _convolutions(*channels: int) -> nn.ModuleList:
    return nn.ModuleList(nn.Conv2d(a, b, 3, padding=1) for a, b in pairwise(channels))


def _chain(layers: Iterable[nn.Module], image: Tensor) -> Tensor:
    """Convolutions, each followed by an activation."""
    for layer in layers:
        image = silu(layer(image))
    return image


def _blocks(image: Tensor) -> Tensor:
    """[B, C, H, W] to [B, 4 C, H/2, W/2]: the four pixels of a block become channels."""
    return pixel_unshuffle(image, 2)


def _coarse(image: Tensor) -> Tensor:
    return nn.functional.avg_pool2d(image, 2)


def _interpolation(fine: int, coarse: int) -> Tensor:
    """[fine, coarse] matrix of linear interpolation; a matrix product has an exportable gradient."""
    lines = torch.eye(coarse)[:, None]
    return interpolate(lines, size=fine, mode="linear", align_corners=False)[:, 0].T.contiguous()


def _fade(side: int) -> Tensor:
    """[side, side]: 1 inside, falling to 0 over the outermost 4 pixels, so that the change is continuous at the
    edge."""
    edge = torch.arange(side, dtype=torch.float32)
    line = (torch.minimum(edge, side - 1 - edge) / 4).clamp(max=1.0)
    return line[:, None] * line


class Underside(NamedTuple):
    """Undersides of tools; [B] each."""

    along_mm: Tensor
    """Distance ahead of the tip at which the underside is half the mean reach higher."""
    across_mm: Tensor
    """Likewise to the side."""
    power: Tensor
    """Above 1: 2 for a ball, more for a flat face."""
    sinking: Tensor
    """Depth that the tip reaches, as a share of the commanded depth."""


def clearance_mm(x_mm: Tensor, y_mm: Tensor, *, length_mm: Tensor, depth_mm: Tensor, tool: Underside) -> Tensor:
    """[B, H, W]: lowest height of the tool's underside over each place, relative to the surface at the start.

    Where the surface is higher, the tool presses it down. The station of the lowest pass is exact for power 2, and on
    the line of travel for all powers.

    Args:
        x_mm, y_mm: [H, W] or [B, H, W] places in the push's frame.
        length_mm, depth_mm: [B].
    """
    length = length_mm[:, None, None] + _MIN_TRAVEL_MM
    depth = depth_mm[:, None, None] * tool.sinking[:, None, None]
    along, across, power = (part[:, None, None] for part in (tool.along_mm, tool.across_mm, tool.power))
    height = 0.5 * (along * across).sqrt()
    slope = (depth / length * along / (height * power) + _TINY).clamp(max=_REACHES)
    trailing = along * (slope.log() / (power - 1)).clamp(max=1.0).exp()
    share = ((x_mm + trailing) / length).clamp(0.0, 1.0)
    distance = ((x_mm - share * length) / along).square() + (y_mm / across).square()
    return height * ((distance + _TINY).log() * power / 2).clamp(max=4.0).exp() - share * depth
