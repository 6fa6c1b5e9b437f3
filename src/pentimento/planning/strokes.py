"""A plan's strokes as tensors that an optimiser can move, and as paths that a robot can execute."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
import torch
from torch import Tensor

from pentimento.contracts.plan import PlannedStroke
from pentimento.robots.motion import timed_path
from pentimento.robots.strokes import press_basis, shape_basis, stroke_points
from pentimento.robots.tools import Tool
from pentimento.stroke_dynamics.photometry import linear_to_srgb, srgb_to_linear


@dataclass
class StrokeTensors:
    """S strokes in SI units, canvas frame; see ``robots.strokes`` for their geometry. All are leaves of the graph."""

    middle_m: Tensor  # [S, 2]
    theta_rad: Tensor  # [S]
    length_m: Tensor  # [S]
    bend_m: Tensor  # [S]
    press_m: Tensor  # [S, 3] at start, middle, end
    color: Tensor  # [S, 3] linear light
    inherited: Mapping[str, Tensor] | None = field(default=None, kw_only=True)
    """[S] each: what the strokes inherit where they stand in a plan (``planning.memory``); None: to be worked out."""

    def __len__(self) -> int:
        return len(self.theta_rad)

    def tensors(self) -> tuple[Tensor, ...]:
        """All six, in the order of the fields."""
        return (self.middle_m, self.theta_rad, self.length_m, self.bend_m, self.press_m, self.color)

    def pick(self, index: Tensor | slice) -> StrokeTensors:
        """A copy of some strokes, in the order of ``index``, detached from any graph. They keep what they inherit."""
        kept = None if self.inherited is None else {name: values[index] for name, values in self.inherited.items()}
        return StrokeTensors(*(t.detach()[index].clone() for t in self.tensors()), inherited=kept)

    def joined(self, others: StrokeTensors) -> StrokeTensors:
        """These strokes, then the others; detached copies."""
        return StrokeTensors(
            *(torch.cat([a.detach(), b.detach()]) for a, b in zip(self.tensors(), others.tensors(), strict=True))
        )

    def colored(self, color: Tensor) -> StrokeTensors:
        """The same strokes in other colours, linear light [S, 3]; the other tensors are shared."""
        return replace(self, color=color)

    def paths(self, points: int) -> Tensor:
        """Commanded paths [S, N, 5], differentiable; times and yaw are 0: see ``planning.memory.commanded``."""
        x, y = self._places(points)
        z = -self.press_m @ _bases(points)[2].T
        zero = torch.zeros_like(x)
        return torch.stack([zero, x, y, z, zero], dim=-1)

    def _places(self, points: int) -> tuple[Tensor, Tensor]:
        """Canvas coordinates along the paths, [S, N] each."""
        along_unit, across_unit, _ = _bases(points)
        along, across = self.length_m[:, None] * along_unit, self.bend_m[:, None] * across_unit
        cos, sin = torch.cos(self.theta_rad)[:, None], torch.sin(self.theta_rad)[:, None]
        return self.middle_m[:, :1] + cos * along - sin * across, self.middle_m[:, 1:] + sin * along + cos * across

    def keep_within(self, tool: Tool, canvas_size_m: tuple[float, float], edge_m: float) -> None:
        """Move each stroke, in place, to the nearest one that the tool can make inside the canvas."""
        with torch.no_grad():
            self.length_m.clamp_(*tool.stroke_length_m)
            low, high = (bound * self.length_m for bound in tool.bend_range)
            self.bend_m.copy_(torch.minimum(torch.maximum(self.bend_m, low), high))
            self.press_m.clamp_(*tool.press_range_m)
            self.color.clamp_(0.0, 1.0)
            # The path's box must lie on the canvas, with a little to spare for the robot's own tolerance.
            for axis, (place, size) in enumerate(zip(self._places(32), canvas_size_m, strict=True)):
                self.middle_m[:, axis] += (edge_m - place.amin(1)).clamp(min=0.0)
                self.middle_m[:, axis] -= (place.amax(1) - (size - edge_m)).clamp(min=0.0)


def no_strokes() -> StrokeTensors:
    """None at all."""
    return StrokeTensors(*(torch.zeros(0, *rest) for rest in ((2,), (), (), (), (3,), (3,))))


@cache
def _bases(points: int) -> tuple[Tensor, Tensor, Tensor]:
    """Shape along and across [N], and press [N, 3], of the strokes' geometry."""
    along, across = (torch.tensor(b, dtype=torch.float32) for b in shape_basis(points))
    return along, across, torch.tensor(press_basis(points), dtype=torch.float32)


def to_planned(strokes: StrokeTensors, tool: Tool, points: int) -> list[PlannedStroke]:
    """The strokes as timed paths that the robot can execute at the tool's speed, dips left to the executor."""
    planned = []
    for i in range(len(strokes)):
        middle, theta, length, bend, press, color = (t[i].detach().double().numpy() for t in strokes.tensors())
        yaw = float(theta) + np.pi / 2 if tool.kind == "flat" else 0.0
        xyz_yaw = stroke_points(middle, float(theta), float(length), float(bend), press, _half_turn(yaw), points)
        srgb = linear_to_srgb(torch.tensor(color)).numpy() if tool.color_srgb is None else np.array(tool.color_srgb)
        planned.append(PlannedStroke(timed_path(xyz_yaw, tool.speed_m_s), np.clip(srgb, 0, 1), dip=False))
    return planned


def with_color(strokes: StrokeTensors, color_srgb: Tensor) -> StrokeTensors:
    """The same strokes in other colours, sRGB [S, 3]."""
    return replace(strokes, color=srgb_to_linear(color_srgb))


def _half_turn(yaw_rad: float) -> float:
    """The same attitude of a flat tool within a quarter turn of 0."""
    return float((yaw_rad + np.pi / 2) % np.pi - np.pi / 2)
