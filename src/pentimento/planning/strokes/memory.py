"""What each stroke of a plan inherits from those before it: ink left, wear, time, wet paint below.

Where a stroke model is extended by a cause with memory, the order of strokes and the dips between them are part of the
plan. The covariates are advanced by the function that collection and execution use, dips fall where the executor makes
them, and speeds are the tool's.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb
from pentimento.contracts.covariates import (
    PICKUP_COLUMNS,
    Memory,
    StrokeEvent,
    covariates_and_advance,
    paint_pickup,
    without_canvas,
)
from pentimento.contracts.plan import PlannedStroke
from pentimento.planning.strokes.brush import Brush, Span
from pentimento.robots.dipping import needs_dip
from pentimento.robots.motion import ACCELERATION_M_S2
from pentimento.robots.tools import Tool

Array = NDArray[np.float32]

_FORESEEN = (
    "since_reload", "reload_id", "ink_since_reload_m", "tool_age_m", "wet_age_s", "order", "t_start_s", "t_after_s",
    *PICKUP_COLUMNS,
)  # fmt: skip
_SHORTEST_M = 1e-9
_NEARLY = 0.02
"""Share of a fitted range by which a value may pass its end before that is worth a word."""


@dataclass(frozen=True, eq=False)
class Start:
    """The state in which a plan begins."""

    memory: Memory
    """Of tool and canvas."""
    clock_s: float
    """Since the session's start."""
    made: int
    """Strokes before the plan's first."""


class Commanded(Protocol):
    """S strokes as far as what they inherit depends on them, whatever numbers describe them."""

    @property
    def theta_rad(self) -> Array:
        """[S] headings."""

    @property
    def color(self) -> Array:
        """[S, 3] linear light."""

    def __len__(self) -> int:
        """S."""

    def paths(self, points: int) -> Array:
        """[S, points, 5] commanded paths, times and yaw 0."""


def commanded(strokes: Commanded, tool: Tool, points: int) -> Array:
    """Paths [S, N, 5] with their yaw, and with times as of a straight stroke at the tool's speed, from rest to rest."""
    paths = strokes.paths(points)
    step = np.linalg.norm(np.diff(paths[..., 1:3], axis=1), axis=-1)
    along = np.concatenate([np.zeros_like(step[:, :1]), np.cumsum(step, axis=1)], axis=1)
    length = np.maximum(along[:, -1:], _SHORTEST_M)
    speed, sharp = tool.speed_m_s, ACCELERATION_M_S2 / math.sqrt(2)
    cruises = length > speed**2 / sharp
    duration = np.where(cruises, length / speed + speed / sharp, 2 * np.sqrt(length / sharp))
    paths[..., 0] = duration * along / length
    if tool.kind == "flat":
        paths[..., 4] = strokes.theta_rad[:, None] + math.pi / 2
    return paths


def inherited(strokes: Commanded, tool: Tool, brush: Brush, start: Start) -> dict[str, Array]:
    """[S] of each column that the brush's marks depend on, held within the range to which it was fitted.

    What neither the plan nor its past knows (humidity, the sheet) is what it was on average.
    """
    fitted = brush.fitted
    known = foreseen(strokes, tool, brush, start, {*fitted, "t_start_s"} if "t_after_s" in fitted else fitted)
    held = {}
    for name, span in fitted.items():
        mean = np.full(len(strokes), span.mean, np.float32)
        held[name] = np.clip(known[name], *span.ends) if name in known else mean
    if "t_after_s" in fitted:  # how long paint has dried stays, wherever its start is held
        begins = known["t_start_s"]
        held["t_after_s"] = known["t_after_s"] - begins + held.get("t_start_s", begins)
    return held


def foreseen(strokes: Commanded, tool: Tool, brush: Brush, start: Start, names: Collection[str]) -> dict[str, Array]:
    """[S] of those of these columns that the plan determines, in the order of execution.

    All strokes are seen when the last is made: it is the finished painting that a plan foretells.
    """
    wanted = [name for name in _FORESEEN if name in names]
    if not wanted:
        return {}
    paths = commanded(strokes, tool, brush.path_points).astype(np.float64)
    colors = linear_to_srgb(strokes.color.astype(np.float64))
    timing, clock_s, memory = brush.timing, start.clock_s, start.memory
    carries = not {*PICKUP_COLUMNS}.isdisjoint(wanted)
    if "wet_age_s" not in wanted and not carries:
        memory = without_canvas(memory)
    rows = []
    for order, (path, color) in enumerate(zip(paths, colors, strict=True), start=start.made):
        dip = needs_dip(tool, PlannedStroke(path, color, dip=False), memory)
        clock_s += timing.reach_s + (timing.dip_s if dip else 0.0)
        event = StrokeEvent(path, clock_s, dip, color)
        carried = paint_pickup(memory, event) if carries else {}
        row, memory = covariates_and_advance(memory, event)
        rows.append(row | carried | {"t_start_s": clock_s, "order": order})
        clock_s += float(path[-1, 0])
    for row in rows:
        row["t_after_s"] = clock_s
    return {name: np.array([row[name] for row in rows], dtype=np.float32) for name in wanted}


def beyond_fit(values: Mapping[str, Array], fitted: Mapping[str, Span]) -> list[str]:
    """A sentence for each column that leaves the range to which a model was fitted, or that no plan foresees."""
    said = []
    for name, (low, mean, high) in fitted.items():
        if name not in values:
            said.append(
                f"{name} is not known of planned strokes: {mean:.3g} is taken, its mean when strokes were made."
            )
            continue
        if name == "t_after_s":
            continue
        known = values[name][np.isfinite(values[name])]
        execution_noise = _NEARLY * (high - low)
        outside = (known < low - execution_noise) | (known > high + execution_noise)
        if outside.any():
            said.append(
                f"{name} runs from {known.min():.3g} to {known.max():.3g} in the plan; the model was fitted from "
                f"{low:.3g} to {high:.3g} and is held at the ends for {int(outside.sum())} of {len(known)} strokes."
            )
    return said
