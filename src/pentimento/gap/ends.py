"""A mark whose two ends differ: what a tool leaves where it comes down and where it lifts off. Part of the base.

Where strokes are straight it looks like a lag. One that leaves nothing for these ends to do takes their place. Any
other cause that moves the path must explain more than they do; once it does, the search looks back and drops them if
nothing speaks for them any more.
"""

from __future__ import annotations

import torch
from torch import Tensor

from pentimento.stroke_dynamics.mechanisms.geometry import arc_m, at_lengths, tangent
from pentimento.stroke_dynamics.simulation import Mechanism, Quantity, StrokeContext
from pentimento.stroke_dynamics.traj2stroke import Mark

_SHORTEST_M = 1e-9
_FARTHEST_IN = 0.45  # of the stroke's length


class UnevenEnds(Mechanism):
    """See above."""

    cause = "uneven_ends"
    site = "trajectory"
    driver = "motion"
    quantities = (
        Quantity("start_m", "m", 0.0005),
        Quantity("end_m", "m", 0.0005),
        Quantity("start_widening", "1", 0.1),
        Quantity("end_widening", "1", 0.1),
    )

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        start_m, end_m, start_widening, end_widening = self.values
        arc, reach = arc_m(context.path), mark.radius_m.mean()
        points, radius = moved_ends(mark.points_m, mark.radius_m, context.path, start_m, end_m)
        widening = start_widening * torch.exp(-arc / reach)
        widening = widening + end_widening * torch.exp(-(arc[..., -1:] - arc) / reach)
        return mark._replace(points_m=points, radius_m=radius * torch.exp(widening))


def moved_ends(
    points_m: Tensor, radius_m: Tensor, path: Tensor, start_m: float | Tensor, end_m: float | Tensor
) -> tuple[Tensor, Tensor]:
    """Points [B, S, N, 2] and radii [B, S, N] of a mark whose ends lie further out, by two lengths, than its path's.

    The points behind an end give way: were it moved alone past its neighbour, a stroke would fold back on itself and
    be no shorter for it. How wide the mark is at a place stays: only its ends are elsewhere. No end is moved in by more
    than to the middle of the stroke.

    Args:
        path: [B, S, N, 5].
    """
    along, arc = tangent(path), arc_m(path)
    length = arc[..., -1:]
    share = arc / length.clamp(min=_SHORTEST_M)
    start, end = (torch.maximum(torch.as_tensor(moved), -_FARTHEST_IN * length) for moved in (start_m, end_m))
    forward = end * share**2 - start * (1 - share) ** 2
    place = (arc + forward).clamp(min=torch.zeros_like(length), max=length)
    return points_m + forward[..., None] * along, at_lengths(place, arc, radius_m[..., None])[..., 0]
