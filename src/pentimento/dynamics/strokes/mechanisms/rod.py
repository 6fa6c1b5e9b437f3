"""What a rod sweeps that is drawn along a path without turning: the mark of an oblong contact patch.

A renderer draws discs along a line. All that a rod sweeps is discs, too: those that touch its outline at two places or
more (the medial axis; Blum 1967). For a rod of half-length a and half-thickness b that moves from S along the unit
vector t, at the angle psi to its own axis u, they lie on the path, with the half-width b + a |sin psi|, from S + a t
on; and before that on two straight branches, to S - a u and S + a u, the corners, where their half-width is b. A stroke
shorter than the rod has a piece along u in its middle instead. Where the path bends, this comes near to what is swept.
"""

from __future__ import annotations

import torch
from torch import Tensor

from pentimento.dynamics.strokes.mechanisms.geometry import arc_m, at_lengths, tangent
from pentimento.dynamics.strokes.traj2stroke import Mark

_FORK = 5
"""Points that the branches at an end take: corner, joint, joint, corner, and back to the joint."""
FEWEST_POINTS = 2 * _FORK + 1
"""That a mark must have for both forks and something between them."""


def swept(mark: Mark, axis: Tensor, half_length_m: Tensor, half_thickness_m: Tensor) -> Mark:
    """The mark of a rod whose middle follows a mark's points [B, S, N, 2], with as many points; its radius is unused.

    Args:
        axis: unit vector along the rod at each point, either way round, [B, S, N, 2].
        half_length_m, half_thickness_m: of the rod at each point, [B, S, N]; the length without its round ends.
    """
    arc = arc_m(_path(mark.points_m))
    along = direction(mark.points_m)
    length = arc[..., -1:]
    # How far from either end the branches join.
    first, last = (torch.minimum(half_length_m[..., [end]], length / 2) for end in (0, -1))
    count = arc.shape[-1]
    share = ((torch.arange(count) - _FORK + 1) / (count - 2 * _FORK + 1)).clamp(0.0, 1.0).to(arc.dtype)
    place = first + share * (length - last - first)

    # A rod is the same either way round, its corners in their order are not: they must not swap at a tiny turn.
    leftward = torch.where(cross(along, axis)[..., None] < 0, -axis, axis)
    points, u, t = (at_lengths(place, arc, field) for field in (mark.points_m, axis, along))
    a, b, density, softness = (
        at_lengths(place, arc, field[..., None])[..., 0]
        for field in (half_length_m, half_thickness_m, mark.density, mark.softness)
    )
    across = cross(u, t).abs()
    radius = b + torch.minimum(a, length / 2) * across
    start, end = (
        _fork(mark.points_m[..., k, :], points[..., k, :], leftward[..., k, :], half_length_m[..., [k]], reach)
        for k, reach in ((0, first), (-1, last))
    )
    points = torch.cat([start, points[..., _FORK:-_FORK, :], end.flip(-2)], dim=-2)
    thin, thick = half_thickness_m, radius
    ends = [thin[..., :1], thick[..., 1:3], thin[..., :1], thick[..., 4:-4], thin[..., -1:], thick[..., -3:-1]]
    return Mark(points, torch.cat([*ends, thin[..., -1:]], dim=-1), density, softness)


def direction(points_m: Tensor) -> Tensor:
    """Unit direction in which points [B, S, N, 2] move on, [B, S, N, 2]."""
    return tangent(_path(points_m))


def cross(a: Tensor, b: Tensor) -> Tensor:
    """Cross product of vectors [..., 2], positive where the second points to the left of the first, [...]."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _fork(tip: Tensor, joint: Tensor, axis: Tensor, half_length_m: Tensor, reach_m: Tensor) -> Tensor:
    """Corner, joint, joint, corner, joint [B, S, 5, 2] of a rod at ``tip`` [B, S, 2]; ``reach_m`` [B, S, 1] is how far
    ``joint`` is from there. What of the rod is longer than that keeps its two joints apart.
    """
    corner, apart = half_length_m * axis, (half_length_m - reach_m) * axis
    return torch.stack([tip - corner, joint - apart, joint + apart, tip + corner, joint + apart], dim=-2)


def _path(points_m: Tensor) -> Tensor:
    """Points as geometry takes them, in the second and third column."""
    return torch.cat([torch.zeros_like(points_m[..., :1]), points_m], dim=-1)
