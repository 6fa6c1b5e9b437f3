"""The geometry that a push cannot avoid: how low the tool's underside passes over each place.

The tool travels along +x of its frame and sinks on a line from the surface to its depth (thesis 7.3.2). Its underside
rises from the tip as a power of the distance, so that a ball (power 2), a tip and a flat face are all near; its reach
along and across, the power and how deep it really goes are fitted. No source: it is the swept volume of such a tool.
"""

from __future__ import annotations

from typing import NamedTuple

from torch import Tensor

_SHORTEST_MM = 0.05  # a travel of no length is a tool pressed straight down
_TINY = 1e-6
_REACHES = 3.0
"""The tool is looked for at most so many reaches away from a place."""


class Underside(NamedTuple):
    """Tools' undersides; [B] each."""

    along_mm: Tensor
    """Where, ahead of the tip, the underside is half the mean reach higher."""
    across_mm: Tensor
    """Likewise to the side."""
    power: Tensor
    """Above 1: 2 for a ball, more for a flat face."""
    sinking: Tensor
    """Depth that the tip reaches as a share of the commanded depth."""


def clearance_mm(x_mm: Tensor, y_mm: Tensor, length_mm: Tensor, depth_mm: Tensor, tool: Underside) -> Tensor:
    """[B, H, W]: the lowest that the tool's underside passes over each place, above the surface at the start.

    Where the surface stands higher, it is in the tool's way. The moment of the lowest pass is exact for power 2, and on
    the line of travel for all powers.

    Args:
        x_mm, y_mm: [H, W] or [B, H, W] places in the push's frame.
        length_mm, depth_mm: [B].
    """
    length = length_mm[:, None, None] + _SHORTEST_MM
    depth = depth_mm[:, None, None] * tool.sinking[:, None, None]
    along, across, power = (part[:, None, None] for part in (tool.along_mm, tool.across_mm, tool.power))
    height = 0.5 * (along * across).sqrt()
    slope = (depth / length * along / (height * power) + _TINY).clamp(max=_REACHES)
    trailing = along * (slope.log() / (power - 1)).clamp(max=1.0).exp()
    share = ((x_mm + trailing) / length).clamp(0.0, 1.0)
    distance = ((x_mm - share * length) / along).square() + (y_mm / across).square()
    return height * ((distance + _TINY).log() * power / 2).clamp(max=4.0).exp() - share * depth
