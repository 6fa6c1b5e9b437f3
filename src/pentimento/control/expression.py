"""How a spoken wish is painted: its colours, the length of its strokes, and the speed of the tool (thesis 6.7)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import lab_to_srgb, srgb_to_lab, to_float, to_uint8
from pentimento.contracts.ranges import above_zero
from pentimento.planning.strokes.config import PlannerConfig
from pentimento.robots.tools import Tool

Picture = NDArray[np.uint8]

_NEW: Final = 10.0
"""Difference of L*a*b* from the canvas from which on a goal's colour is wholly changed; below it, in proportion."""
_VISIBLE: Final = 0.02
"""Smaller changes by a factor are not mentioned."""
_VISIBLE_LIGHTNESS: Final = 1.0
"""Nor are smaller changes of L*: 1 is about what is just seen."""


@dataclass(frozen=True)
class Expression:
    """What is changed about a painting because of the way in which it was asked for."""

    said: str
    """That way in words, such as "loudly and fast"; "" for an ordinary one."""
    chroma: float
    """Factor of the goal's chroma in L*a*b*."""
    lightness: float
    """Added to the goal's L* (0 to 100)."""
    length: float
    """Factor of the shortest strokes' length if above 1, of the longest strokes' length if below."""
    tempo: float
    """Factor of the tool's speed."""

    def __post_init__(self) -> None:
        above_zero(self, "chroma", "length", "tempo")
        if not math.isfinite(self.lightness):
            raise ValueError(f"lightness is {self.lightness}; it must be finite.")

    def tool(self, tool: Tool, max_speed_m_s: float = math.inf) -> Tool:
        """The tool, narrowed to the strokes of this expression and at its speed, within the tool's own ranges.

        Args:
            max_speed_m_s: what the robot allows.
        """
        if self.length == self.tempo == 1.0:
            return tool
        low, high = tool.stroke_length_m
        lengths = (min(low * max(self.length, 1.0), high), max(high * min(self.length, 1.0), low))
        slowest, fastest = tool.speed_range_m_s
        fastest = max(min(fastest, max_speed_m_s), tool.speed_m_s)
        return replace(tool, stroke_length_m=lengths, speed_m_s=min(max(tool.speed_m_s * self.tempo, slowest), fastest))

    def goal(self, goal: Picture, canvas: Picture) -> Picture:
        """The goal, uint8 sRGB [H, W, 3], in the colours of this expression where it differs from the canvas.

        Colours that no screen shows are cut to the nearest value in each channel.
        """
        if self.chroma == 1.0 and self.lightness == 0.0:
            return goal
        before, wanted = srgb_to_lab(to_float(canvas)), srgb_to_lab(to_float(goal))
        share = np.clip(np.linalg.norm(wanted - before, axis=-1) / _NEW, 0.0, 1.0)
        changed = wanted * np.array([1.0, self.chroma, self.chroma], np.float32)
        changed[..., 0] += np.float32(self.lightness)
        mixed = wanted + share[..., None] * (changed - wanted)
        return np.where(share[..., None] > 0, to_uint8(np.clip(lab_to_srgb(mixed), 0.0, 1.0)), goal)

    def sentence(self) -> str:
        """What changes, for the person."""
        changes = []
        colours = ["more vivid" if self.chroma > 1 else "duller"] if abs(self.chroma - 1) > _VISIBLE else []
        colours += ["lighter" if self.lightness > 0 else "darker"] if abs(self.lightness) >= _VISIBLE_LIGHTNESS else []
        if colours:
            changes.append(f"{' and '.join(colours)} colours")
        if abs(self.length - 1) > _VISIBLE:
            changes.append(f"{'longer' if self.length > 1 else 'shorter'} strokes")
        if abs(self.tempo - 1) > _VISIBLE:
            changes.append(f"{abs(self.tempo - 1) * 100:.0f} % {'faster' if self.tempo > 1 else 'slower'}")
        if not changes:
            return f"Said {self.said or 'in an ordinary way'}: painted as a typed wish."
        return f"Said {self.said}: {', '.join(changes)}."


PLAIN: Final = Expression("", chroma=1.0, lightness=0.0, length=1.0, tempo=1.0)
"""Of typed wishes: nothing changes."""


def has_free_colours(tool: Tool, planner: PlannerConfig) -> bool:
    """Whether a planner chooses its paints by the goal, rather than take the tool's ink or paints that are given."""
    return tool.color_srgb is None and planner.palette.source == "plan"
