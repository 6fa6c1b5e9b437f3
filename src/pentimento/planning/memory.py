"""What each stroke of a plan inherits from those before it: ink left, wear, time, wet paint below.

Where a stroke model is extended by a cause with memory, the order of strokes and the dips between them are part of the
plan. The covariates are advanced by the function that collection and execution use, dips fall where the executor makes
them, and speeds are the tool's.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from pentimento.contracts.covariates import Memory, StrokeEvent, covariates_and_advance, without_canvas
from pentimento.contracts.plan import PlannedStroke
from pentimento.planning.strokes import StrokeTensors
from pentimento.robots.motion import ACCELERATION_M_S2
from pentimento.robots.tools import Tool
from pentimento.runner.act import needs_dip
from pentimento.stroke_dynamics.extended import StrokeModel
from pentimento.stroke_dynamics.photometry import linear_to_srgb
from pentimento.stroke_dynamics.simulation import StrokeContext

_FORESEEN = (
    "since_reload", "reload_id", "ink_since_reload_m", "tool_age_m", "wet_age_s", "order", "t_start_s", "t_after_s",
)  # fmt: skip
_SHORTEST_M = 1e-9
_NEARLY = 0.02
"""Share of a fitted range by which a value may pass its end before that is worth a word."""


@dataclass(frozen=True, eq=False)
class Extension:
    """What extends a scene's stroke model, and the state in which the plan begins."""

    model: StrokeModel
    memory: Memory
    clock_s: float
    """Since the session's start."""
    made: int
    """Strokes before the plan's first."""


def context_of(strokes: StrokeTensors, tool: Tool, extension: Extension | None, points: int) -> StrokeContext:
    """The strokes as mechanisms see them, [1, S, ...]; differentiable in the paths, not in what is inherited.

    Inherited values are those that the strokes carry (see ``StrokeTensors.inherited``), else they are worked out here.
    Without an extension nothing is inherited, and times and yaw are 0.
    """
    paths = strokes.paths(points)
    if extension is None:
        return StrokeContext(paths[None], {})
    return StrokeContext(commanded(paths, strokes, tool)[None], _WhenAsked(strokes, tool, extension, points))


class _WhenAsked(Mapping[str, Tensor]):
    """[1, S] of each column that the model's mechanisms may read, worked out when one of them does."""

    def __init__(self, strokes: StrokeTensors, tool: Tool, extension: Extension, points: int) -> None:
        self._strokes, self._tool, self._extension, self._points = strokes, tool, extension, points
        self._known: dict[str, Tensor] = dict(strokes.inherited or {})

    def __getitem__(self, name: str) -> Tensor:
        if name not in self._known:
            # All at once, but for the one that has to look at the canvas and takes several times as long.
            names = [n for n in self._extension.model.fitted if n == name or n != "wet_age_s"]
            self._known |= inherited(self._strokes, self._tool, self._extension, self._points, names)
        return self._known[name][None]

    def __contains__(self, name: object) -> bool:
        return name in self._extension.model.fitted

    def __iter__(self) -> Iterator[str]:
        return iter(self._extension.model.fitted)

    def __len__(self) -> int:
        return len(self._extension.model.fitted)


def commanded(paths: Tensor, strokes: StrokeTensors, tool: Tool) -> Tensor:
    """Paths [S, N, 5] with their yaw, and with times as of a straight stroke at the tool's speed, from rest to rest."""
    step = paths[..., 1:3].diff(dim=-2).norm(dim=-1)
    along = torch.cat([torch.zeros_like(step[:, :1]), step.cumsum(-1)], dim=-1)
    length = along[:, -1:].clamp(min=_SHORTEST_M)
    speed, sharp = tool.speed_m_s, ACCELERATION_M_S2 / math.sqrt(2)
    cruises = length > speed**2 / sharp
    duration = torch.where(cruises, length / speed + speed / sharp, 2 * (length / sharp).sqrt())
    yaw = strokes.theta_rad[:, None] + math.pi / 2 if tool.kind == "flat" else torch.zeros_like(length)
    times = duration * along / length
    return torch.cat([times[..., None], paths[..., 1:4], yaw.expand_as(times)[..., None]], dim=-1)


def inherited(
    strokes: StrokeTensors, tool: Tool, extension: Extension, points: int, names: Collection[str]
) -> dict[str, Tensor]:
    """[S] of each of these columns, held within the range to which the model was fitted.

    What neither the plan nor its past knows (humidity, the sheet) is what it was on average.
    """
    known = foreseen(strokes, tool, extension, points, {*names, "t_start_s"} if "t_after_s" in names else names)
    held = {}
    for name in names:
        span = extension.model.fitted[name]
        held[name] = known[name].clamp(*span.ends) if name in known else torch.full((len(strokes),), span.mean)
    if "t_after_s" in names:  # how long paint has dried stays, wherever its start is held
        start = known["t_start_s"]
        ends = extension.model.fitted["t_start_s"].ends if "t_start_s" in extension.model.fitted else (None, None)
        held["t_after_s"] = known["t_after_s"] - start + start.clamp(*ends)
    return held


def foreseen(
    strokes: StrokeTensors, tool: Tool, extension: Extension, points: int, names: Collection[str]
) -> dict[str, Tensor]:
    """[S] of those of these columns that the plan determines, in the order of execution.

    All strokes are seen when the last is made: it is the finished painting that a plan foretells.
    """
    wanted = [name for name in _FORESEEN if name in names]
    if not wanted:
        return {}
    with torch.no_grad():
        paths = commanded(strokes.paths(points), strokes, tool).double().numpy()
        colors = linear_to_srgb(strokes.color.detach().double()).numpy()
    pace, clock_s, memory = extension.model.pace, extension.clock_s, extension.memory
    if "wet_age_s" not in wanted:
        memory = without_canvas(memory)
    rows = []
    for order, (path, color) in enumerate(zip(paths, colors, strict=True), start=extension.made):
        dip = needs_dip(tool, PlannedStroke(path, color, dip=False), memory)
        clock_s += pace.reach_s + (pace.dip_s if dip else 0.0)
        event = StrokeEvent(path, clock_s, dip, color)
        row, memory = covariates_and_advance(memory, event)
        rows.append(row | {"t_start_s": clock_s, "order": order})
        clock_s += float(path[-1, 0])
    for row in rows:
        row["t_after_s"] = clock_s
    return {name: torch.tensor([float(row[name]) for row in rows], dtype=torch.float32) for name in wanted}  # type: ignore[arg-type]


def beyond_fit(values: Mapping[str, Tensor], model: StrokeModel) -> list[str]:
    """A sentence for each column that leaves the range to which the model was fitted, or that no plan foresees."""
    said = []
    for name, (low, mean, high) in model.fitted.items():
        if name not in values:
            said.append(
                f"{name} is not known of planned strokes: {mean:.3g} is taken, its mean when strokes were made."
            )
            continue
        if name == "t_after_s":
            continue
        known = values[name].numpy()[np.isfinite(values[name].numpy())]
        slack = _NEARLY * (high - low)
        outside = (known < low - slack) | (known > high + slack)
        if outside.any():
            said.append(
                f"{name} runs from {known.min():.3g} to {known.max():.3g} in the plan; the model was fitted from "
                f"{low:.3g} to {high:.3g} and is held at the ends for {int(outside.sum())} of {len(known)} strokes."
            )
    return said
