"""Covariates that a planned stroke inherits from the strokes before it: ink left, wear, time, wet paint below.

Where a stroke model has a mechanism with memory, the order of strokes and the dips between them are part of the plan.
The covariates are advanced by the function that collection and execution use (``contracts.covariates``). Dips fall
where the executor makes them, and speeds are the tool's.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

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
from pentimento.planning.strokes.paths import PlannedPaths
from pentimento.robots.motion import ACCELERATION_M_S2
from pentimento.robots.refill import needs_dip
from pentimento.robots.tools import Tool

Array = NDArray[np.float32]

_PLANNED = (
    "since_reload", "reload_id", "ink_since_reload_m", "tool_age_m", "wet_age_s", "order", "t_start_s", "t_after_s",
    *PICKUP_COLUMNS,
)  # fmt: skip
"""The columns that a plan determines."""
_MIN_LENGTH_M = 1e-9
"""Floor under a path's length, against division by zero."""
_TOLERANCE = 0.02
"""Share of a fitted range by which a value may pass its end before a warning names it."""


@dataclass(frozen=True, eq=False)
class Start:
    """The state in which a plan begins."""

    memory: Memory
    """State of tool and canvas."""
    clock_s: float
    """Time since the session's start."""
    made: int
    """Strokes before the plan's first."""


def commanded(strokes: PlannedPaths, tool: Tool, points: int) -> Array:
    """Commanded paths [S, N, 5] with times and yaw."""
    return add_times_and_yaw(strokes.paths(points), strokes.theta_rad, tool)


def add_times_and_yaw(paths: Array, theta_rad: Array, tool: Tool) -> Array:
    """Set times and yaw of paths [S, N, 5], in place, and return them.

    Times are those of a straight stroke of the path's length at the tool's speed, from rest to rest. A flat tool's
    broad edge is square to the heading ``theta_rad`` [S].
    """
    step = np.linalg.norm(np.diff(paths[..., 1:3], axis=1), axis=-1)
    along = np.concatenate([np.zeros_like(step[:, :1]), np.cumsum(step, axis=1)], axis=1)
    length = np.maximum(along[:, -1:], _MIN_LENGTH_M)
    speed, acceleration = tool.speed_m_s, ACCELERATION_M_S2 / math.sqrt(2)
    cruises = length > speed**2 / acceleration
    duration = np.where(cruises, length / speed + speed / acceleration, 2 * np.sqrt(length / acceleration))
    paths[..., 0] = duration * along / length
    if tool.kind == "flat":
        paths[..., 4] = theta_rad[:, None] + math.pi / 2
    return paths


def inherited(strokes: PlannedPaths, tool: Tool, brush: Brush, start: Start) -> dict[str, Array]:
    """[S] of each column that the brush's marks depend on, clipped to the range to which the model was fitted.

    A column that neither the plan nor its past determines (humidity, the sheet) is at its mean in the fit.
    """
    fitted = brush.fitted
    names = {*fitted, "t_start_s"} if "t_after_s" in fitted else fitted
    known = planned_covariates(strokes, tool, brush, start, names=names)
    values = {}
    for name, span in fitted.items():
        mean = np.full(len(strokes), span.mean, np.float32)
        values[name] = np.clip(known[name], *span.ends) if name in known else mean
    if "t_after_s" in fitted:  # the drying time is kept where the start time is clipped
        begins = known["t_start_s"]
        values["t_after_s"] = known["t_after_s"] - begins + values.get("t_start_s", begins)
    return values


def planned_covariates(
    strokes: PlannedPaths, tool: Tool, brush: Brush, start: Start, *, names: Collection[str]
) -> dict[str, Array]:
    """[S] of those of these columns that the plan determines, in the order of execution.

    ``t_after_s`` of all strokes is the end of the last: a plan predicts the finished painting.
    """
    wanted = [name for name in _PLANNED if name in names]
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
        dip = needs_dip(tool, PlannedStroke(path, color, dip=False), memory, brush.depletion)
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
    """A warning for each fitted column that leaves the range of the fit, or that no plan determines."""
    warnings = []
    for name, span in fitted.items():
        if name not in values:
            warnings.append(
                f"A plan does not determine {name}; its mean over the fitted strokes, {span.mean:.3g}, is used."
            )
            continue
        if name == "t_after_s":
            continue
        known = values[name][np.isfinite(values[name])]
        low, high = span.ends
        tolerance = _TOLERANCE * (high - low)
        outside = (known < low - tolerance) | (known > high + tolerance)
        if outside.any():
            warnings.append(
                f"{name} runs from {known.min():.3g} to {known.max():.3g} in the plan. The model was fitted from "
                f"{low:.3g} to {high:.3g}; {int(outside.sum())} of {len(known)} strokes are clipped to that range."
            )
    return warnings
