"""What a camera will see of strokes: a stroke model's mark, changed by mechanisms at five sites, laid on the canvas.

    path ─ model ─→ points ─→ radius ─→ density, softness ─→ colour, pickup ─→ composition ─→ image
                 trajectory   width       density             composite                      camera

A mechanism is one named cause of what the model alone gets wrong. It overrides the site at which it acts; at all others
it is the identity. Everything is differentiable in the mechanisms' parameters, the model's, and the paths.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import torch
from torch import Tensor, nn

from pentimento.stroke_dynamics.autograd import render_strokes
from pentimento.stroke_dynamics.traj2stroke import Mark


class View(NamedTuple):
    """Which part of the canvas each of B images shows."""

    top_left_m: Tensor  # [B, 2] x_min, y_max
    pixels_per_m: Tensor  # [B]

    def to_pixels(self, points_m: Tensor) -> Tensor:
        """Canvas points [B, ..., 2] to pixel coordinates (column, row)."""
        lead = (-1,) + (1,) * (points_m.ndim - 2)
        scale = self.pixels_per_m.view(lead)
        x = (points_m[..., 0] - self.top_left_m[:, 0].view(lead)) * scale - 0.5
        y = (self.top_left_m[:, 1].view(lead) - points_m[..., 1]) * scale - 0.5
        return torch.stack([x, y], dim=-1)


class StrokeContext(NamedTuple):
    """What is known of B x S strokes before they are made."""

    path: Tensor
    """[B, S, N, 5] commanded: t_s, x_m, y_m, z_m, yaw_rad."""
    covariates: Mapping[str, Tensor]
    """[B, S] each: columns of the strokes contract."""


class Mechanism(nn.Module):
    """One cause. With its parameters at zero it changes nothing."""

    def trajectory(self, points_m: Tensor, context: StrokeContext) -> Tensor:
        """Where the tool touches, [B, S, N, 2]."""
        return points_m

    def width(self, radius_m: Tensor, context: StrokeContext) -> Tensor:
        """Half the mark's width, [B, S, N]."""
        return radius_m

    def density(self, density: Tensor, softness: Tensor, context: StrokeContext) -> tuple[Tensor, Tensor]:
        """Coverage on the path and its fall towards the rim, [B, S, N] each."""
        return density, softness

    def composite(self, color: Tensor, pickup: Tensor | None, context: StrokeContext) -> tuple[Tensor, Tensor | None]:
        """The paint, linear light [B, S, 3], and the share of wet paint picked up, [B, S] or none."""
        return color, pickup

    def camera(self, image: Tensor, view: View) -> Tensor:
        """The image, linear light [B, H, W, 3]."""
        return image


def extended_mark(base: Callable[[Tensor], Mark], mechanisms: Sequence[Mechanism], context: StrokeContext) -> Mark:
    """The base model's mark after the sites trajectory, width and density."""
    points, radius, density, softness = base(context.path)
    for mechanism in mechanisms:
        points = mechanism.trajectory(points, context)
    for mechanism in mechanisms:
        radius = mechanism.width(radius, context)
    for mechanism in mechanisms:
        density, softness = mechanism.density(density, softness, context)
    return Mark(points, radius, density, softness)


def simulate(
    base: Callable[[Tensor], Mark],
    mechanisms: Sequence[Mechanism],
    context: StrokeContext,
    color: Tensor,
    canvas: Tensor,
    view: View,
) -> Tensor:
    """The images after the strokes, linear light.

    Args:
        base: the stroke model, paths [..., N, 5] to marks.
        mechanisms: in the order in which they act at one site.
        color: [B, S, 3], linear light.
        canvas: [B, H, W, 3], linear light; with a fourth channel, wetness, where a mechanism picks up paint.

    Returns:
        [B, H, W, 3].
    """
    mark = extended_mark(base, mechanisms, context)
    pickup = None
    for mechanism in mechanisms:
        color, pickup = mechanism.composite(color, pickup, context)
    image = render_strokes(
        view.to_pixels(mark.points_m),
        mark.radius_m * view.pixels_per_m[:, None, None],
        mark.density,
        mark.softness,
        color,
        canvas,
        pickup,
    )[..., :3]
    for mechanism in mechanisms:
        image = mechanism.camera(image, view)
    return image
