"""Width depends on the heading relative to the tool's yaw: the contact patch is oblong.

With h the heading minus the yaw and e the length of (cos, sin), the patch's elongation: for small e the half-width
changes by the factor exp(a), a = cos cos 2h + sin sin 2h, and the patch's extent ahead and behind, at the stroke's
ends, by exp(-a). For large e the ends are slanted or square: the mark is the area that a rod sweeps (``swept``) with
the half-extents exp(e) and exp(-e) times the half-width. Forked ends do not grow smoothly out of a round one; their
share is e^2 / (e^2 + e0^2).
"""

from __future__ import annotations

import torch
from torch import Tensor

from pentimento.dynamics.strokes.mechanisms.geometry import arc_m, at_lengths, canvas_directions, moved_ends, tangent
from pentimento.dynamics.strokes.simulation import Mechanism, NotObservable, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark

_MIN_SPREAD = 0.02
"""Spread (1 - mean resultant length) of doubled headings below which all strokes run the same way."""
_LITTLE = 0.1
"""e0: below it the mark is mostly one of another width, above it mostly what a rod sweeps."""


class OrientationWidth(Mechanism):
    cause = "orientation_width"
    site = "width"
    driving_covariate = "heading"
    informative_covariates = ("heading_cos", "heading_sin")
    quantities = (
        Quantity("cos", "1", 0.2),
        Quantity("sin", "1", 0.2),
    )

    @classmethod
    def reference_of(cls, context: StrokeContext) -> dict[str, float]:
        # Where all strokes have one direction, headings differ only along bends and measure the distance from the ends.
        if _spread_of_headings(context) < _MIN_SPREAD:
            raise NotObservable("all strokes run the same way against the tool's yaw")
        return canvas_directions(context)

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        """See ``Mechanism``. Marks with too few points for forked ends keep round ones."""
        # With bristle lag the patch's direction counts, not the command's.
        along, yaw = direction(mark.points_m), context.path[..., 4]
        cos, sin = self.values
        twice = 2 * (torch.atan2(along[..., 1], along[..., 0]) - yaw)
        wider = cos * torch.cos(twice) + sin * torch.sin(twice)
        beyond_m = mark.radius_m * (torch.exp(-wider) - torch.exp(wider))
        points, radius = moved_ends(
            mark.points_m, mark.radius_m * torch.exp(wider), context.path, beyond_m[..., :1], beyond_m[..., -1:]
        )
        widened = mark._replace(points_m=points, radius_m=radius)
        if mark.radius_m.shape[-1] < MIN_POINTS:
            return widened
        square = cos.square() + sin.square()
        # Without effect the rod's share is 0; only its gradient must be finite.
        cos = torch.where(square > 0, cos, 1.0)
        oblong = (cos.square() + sin.square()).sqrt()
        broadside = yaw + torch.atan2(sin, cos) / 2
        axis = torch.stack([-torch.sin(broadside), torch.cos(broadside)], dim=-1)
        half_length = 2 * torch.sinh(oblong) * mark.radius_m
        rod = swept(mark, axis, half_length, torch.exp(-oblong) * mark.radius_m)
        share = square / (square + _LITTLE**2)
        return Mark(*(plain + share * (forked - plain) for plain, forked in zip(widened, rod, strict=True)))


def _spread_of_headings(context: StrokeContext) -> float:
    """Circular spread of the chords' doubled directions against the yaw: 0 all equal, 1 uniform."""
    chords = (context.path[..., -1, 1:3] - context.path[..., 0, 1:3]).flatten(0, -2)
    twice = 2 * (torch.atan2(chords[:, 1], chords[:, 0]) - context.path[..., 0, 4].flatten())
    return 1 - float(torch.stack([torch.cos(twice).mean(), torch.sin(twice).mean()]).norm())


_FORK = 5
"""Points that the branches at an end take: corner, joint, joint, corner, and back to the joint."""
MIN_POINTS = 2 * _FORK + 1
"""That a mark must have for both forks and something between them."""


def swept(mark: Mark, axis: Tensor, half_length_m: Tensor, half_thickness_m: Tensor) -> Mark:
    """The mark of a rod whose middle follows a mark's points [B, S, N, 2], with as many points; its radius is unused.

    A renderer draws discs along a line. The area that a rod sweeps is a union of discs, too: those that touch its
    outline at two places or more (the medial axis; Blum 1967). For a rod of half-length a and half-thickness b that
    moves from S along the unit vector t, at the angle psi to its own axis u, they lie on the path from S + a t on, with
    the half-width b + a |sin psi|; before that on two straight branches to the corners S - a u and S + a u, where their
    half-width is b. A stroke shorter than the rod has a segment along u in its middle instead. On bent paths this is
    approximate.

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
