"""When a tool that takes its paint from a palette is dipped: by count, and by the diagnosed depletion of its load.

A mark's darkness is what it takes away of the ground's light across its width: opacity times width. Under the diagnosed
cause ``ink_depletion`` both fall exponentially with what a load was used for, so darkness is exp(-loss · used) of that
of a fresh load. The tool is dipped before the stroke at whose end the share 1 - exp(-loss · used) exceeds the tool's
``max_fade``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.covariates import Memory, StrokeEvent, advance, drawn_length_m, without_canvas
from pentimento.contracts.plan import PlannedStroke
from pentimento.robots.tools import Tool, same_colour

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Depletion:
    """How a diagnosed stroke model loses darkness with what a load was used for."""

    column: Literal["ink_since_reload_m", "since_reload"]
    """What the use of a load is counted in: metres drawn, or strokes before this one."""
    loss: float
    """Of the logarithm of darkness, per metre or per stroke; zero or less for a load that does not run out."""

    def fade(self, path: FloatArray, memory: Memory) -> float:
        """Share of a fresh load's darkness that is missing at the end of a path [N, 5], drawn without a dip."""
        used = float(memory.since_reload)
        if self.column == "ink_since_reload_m":
            used = memory.ink_since_reload_m + drawn_length_m(path)
        return 1 - math.exp(-max(self.loss, 0.0) * used)

    def load_m(self, max_fade: float) -> float:
        """Length after which a fresh load has faded by this share; infinite where it is counted in strokes."""
        runs_out = self.column == "ink_since_reload_m" and self.loss > 0
        return -math.log(1 - max_fade) / self.loss if runs_out else math.inf


def needs_dip(tool: Tool, stroke: PlannedStroke, memory: Memory, depletion: Depletion | None) -> bool:
    """Whether the tool must be dipped before the stroke, for the executor and for the planner.

    Always where the stroke asks for it, where its colour changes, and at the tool's limit of strokes a load. Without
    ``depletion`` that limit is ``strokes_per_dip``. With it the limit is ``max_strokes_per_dip`` where the tool has
    one, and a tool with a ``max_fade`` is dipped before the stroke at whose end it would have faded by more.
    """
    if not tool.dips:
        return False
    changes = not same_colour(memory.last_color_srgb, stroke.color_srgb)  # also where nothing is known yet
    limit = tool.strokes_per_dip if depletion is None else tool.most_strokes_per_dip
    if stroke.dip or changes or memory.since_reload >= limit:
        return True
    if depletion is None or tool.max_fade is None or memory.since_reload == 0:
        return False
    return depletion.fade(stroke.path, memory) > tool.max_fade


def with_dips(
    strokes: Sequence[PlannedStroke], tool: Tool, memory: Memory, depletion: Depletion | None
) -> list[PlannedStroke]:
    """The strokes of a plan, each of which says whether the tool is dipped before it, executed from ``memory`` on."""
    memory, decided = without_canvas(memory), []
    for stroke in strokes:
        dip = needs_dip(tool, stroke, memory, depletion)
        memory = advance(memory, StrokeEvent(stroke.path, 0.0, dip, stroke.color_srgb))
        decided.append(replace(stroke, dip=dip))
    return decided


def too_long(strokes: Sequence[PlannedStroke], tool: Tool, depletion: Depletion | None) -> str:
    """A sentence on strokes that fade by more than the tool's ``max_fade`` even with a fresh load; "" without any."""
    if not tool.dips or depletion is None or tool.max_fade is None:
        return ""
    load_m = depletion.load_m(tool.max_fade)
    lengths_m = [drawn_length_m(stroke.path) for stroke in strokes]
    count = sum(length_m > load_m for length_m in lengths_m)
    if not count:
        return ""
    which = "1 stroke is" if count == 1 else f"{count} strokes are"
    return (
        f"{which} too long for one load of paint: a fresh load loses {tool.max_fade:.0%} of its darkness within "
        f"{1000 * load_m:.0f} mm, and the longest stroke has {1000 * max(lengths_m):.0f} mm; lower the maximum of "
        f"stroke_length of the {tool.name} to avoid that."
    )
