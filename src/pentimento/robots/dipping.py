"""When a tool is dipped: the executor asks before each stroke, and a planner who foresees what strokes inherit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.covariates import Memory
from pentimento.contracts.plan import PlannedStroke
from pentimento.robots.tools import Tool

FloatArray = NDArray[np.float64]

_SAME_COLOUR = 0.5 / 255


def needs_dip(tool: Tool, stroke: PlannedStroke, memory: Memory) -> bool:
    """Whether the tool must be dipped before the stroke."""
    if not tool.dips:
        return False
    changes = not same_colour(memory.last_color_srgb, stroke.color_srgb)  # also where nothing is known yet
    return stroke.dip or changes or memory.since_reload >= tool.strokes_per_dip


def same_colour(one_srgb: FloatArray, other_srgb: FloatArray) -> bool:
    """Whether two colours are one 8-bit colour; never true of NaN."""
    return bool(np.all(np.abs(np.asarray(one_srgb) - np.asarray(other_srgb)) <= _SAME_COLOUR))
