"""A stroke model for the planner: marks of planned strokes, and the strokes' gradients from those of the marks.

``planned_marks`` is one function of tensors: the strokes' geometry, the base model, and the mechanisms at the sites
trajectory, width, density and composite. The robot's bundle holds this function as an ONNX graph.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import torch
from torch import Tensor

from pentimento.dynamics.strokes.extended import StrokeModel
from pentimento.dynamics.strokes.mechanisms.ink_depletion import InkDepletion
from pentimento.dynamics.strokes.simulation import Mechanism, StrokeContext, View, final_mark
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.brush import Array, Marks, Pull, Span, StrokeTiming
from pentimento.robots.motion import ACCELERATION_M_S2
from pentimento.robots.refill import Depletion
from pentimento.robots.strokes import press_basis, shape_basis
from pentimento.robots.tools import Tool

_SHORTEST_M = 1e-9
_PIXELS_PER_M = 1e4
"""Resolution of the one-pixel images in which a camera's gain is evaluated."""


class BezierTensors(NamedTuple):
    """The arrays of ``planning.strokes.bezier.Strokes`` as tensors, S strokes."""

    middle_m: Tensor  # [S, 2]
    theta_rad: Tensor  # [S]
    length_m: Tensor  # [S]
    bend_m: Tensor  # [S]
    press_m: Tensor  # [S, 3] at start, middle, end
    color: Tensor  # [S, 3] linear light


def planned_marks(
    model: StrokeModel, tool: Tool, strokes: BezierTensors, *, path_points: int, covariates: Mapping[str, Tensor]
) -> tuple[Tensor, ...]:
    """The marks of planned strokes; differentiable in the strokes, without branches on their values.

    Args:
        path_points: N, of each path.
        covariates: [S] of each column in ``model.fitted``.

    Returns:
        The fields of ``planning.strokes.brush.Marks`` in their order. The last, pickup, is left out where no mechanism
        picks up paint.
    """
    # The base knows neither times nor yaw.
    extended = model.mechanisms or model.correction
    path = commanded_paths(strokes, path_points, tool) if extended else _geometry(strokes, path_points)
    return marks_of_paths(model, path, strokes.color, covariates)


def marks_of_paths(
    model: StrokeModel, path: Tensor, color: Tensor, covariates: Mapping[str, Tensor]
) -> tuple[Tensor, ...]:
    """The marks of commanded paths [S, N, 5] in colours [S, 3], linear light; see ``planned_marks``."""
    context = StrokeContext(path[None], {name: values[None] for name, values in covariates.items()})
    mark = final_mark(model.mark(), model.mechanisms, context, model.correction)
    paint, pickup = color[None], None
    for mechanism in model.mechanisms:
        paint, pickup = mechanism.composite(paint, pickup, context)
    fields = (*mark, paint) if pickup is None else (*mark, paint, pickup)
    return tuple(values[0] for values in fields)


def depletion_of(model: StrokeModel) -> Depletion | None:
    """How the tool's load runs out, by the mechanism ``ink_depletion``; None for a model without it.

    The loss of darkness, density times width, is the sum of both quantities.
    """
    for mechanism in model.mechanisms:
        if isinstance(mechanism, InkDepletion):
            loss = float(mechanism.values.detach().sum()) / mechanism.reference["since"]
            return Depletion("since_reload" if mechanism.reference["column"] else "ink_since_reload_m", loss)
    return None


def commanded_paths(strokes: BezierTensors, points: int, tool: Tool) -> Tensor:
    """Commanded paths [S, N, 5] of Bézier strokes, with times and yaw."""
    return _commanded(_geometry(strokes, points), strokes.theta_rad, tool)


def _geometry(strokes: BezierTensors, points: int) -> Tensor:
    """Paths [S, N, 5], times and yaw 0; ``planning.strokes.bezier.Strokes.paths`` is the same in numpy."""
    middle_m, theta_rad, length_m, bend_m, press_m, _ = strokes
    along_unit, across_unit = (torch.tensor(basis, dtype=middle_m.dtype) for basis in shape_basis(points))
    press_unit = torch.tensor(press_basis(points), dtype=middle_m.dtype)
    along, across = length_m[:, None] * along_unit, bend_m[:, None] * across_unit
    cos, sin = torch.cos(theta_rad)[:, None], torch.sin(theta_rad)[:, None]
    x = middle_m[:, :1] + cos * along - sin * across
    y = middle_m[:, 1:] + sin * along + cos * across
    z = -press_m @ press_unit.T
    zero = torch.zeros_like(x)
    return torch.stack([zero, x, y, z, zero], dim=-1)


def _commanded(path: Tensor, theta_rad: Tensor, tool: Tool) -> Tensor:
    """Paths with yaw and times; ``planning.strokes.memory.commanded`` is the same in numpy."""
    step = path[..., 1:3].diff(dim=-2).norm(dim=-1)
    drawn = torch.cat([torch.zeros_like(step[..., :1]), step.cumsum(-1)], dim=-1)
    length = drawn[..., -1:].clamp(min=_SHORTEST_M)
    speed, sharp = tool.speed_m_s, ACCELERATION_M_S2 / math.sqrt(2)
    cruises = length > speed**2 / sharp
    duration = torch.where(cruises, length / speed + speed / sharp, 2 * (length / sharp).sqrt())
    times = duration * drawn / length
    yaw = theta_rad[:, None] + math.pi / 2 if tool.kind == "flat" else torch.zeros_like(length)
    return torch.cat([times[..., None], path[..., 1:4], yaw.expand_as(times)[..., None]], dim=-1)


class TorchBrush:
    """A stroke model as a ``planning.strokes.brush.Brush``, its gradients by autograd."""

    def __init__(self, model: StrokeModel, tool: Tool, path_points: int) -> None:
        self.model, self.tool, self.path_points = model, tool, path_points
        self._camera = [m for m in model.mechanisms if type(m).camera is not Mechanism.camera]

    @property
    def fitted(self) -> Mapping[str, Span]:
        """Every column that the mechanisms read."""
        return self.model.fitted

    @property
    def timing(self) -> StrokeTiming:
        """As recorded."""
        return self.model.timing

    @property
    def depletion(self) -> Depletion | None:
        """Of the mechanism ``ink_depletion``."""
        return depletion_of(self.model)

    def marks(self, strokes: Strokes, inherited: Mapping[str, Array]) -> tuple[Marks, Pull]:
        """See ``planning.strokes.brush.Brush``. The way back may be gone once."""
        leaves = BezierTensors(*(torch.tensor(array, requires_grad=True) for array in strokes.arrays()))
        columns = {name: torch.tensor(inherited[name]) for name in self.fitted}
        with torch.enable_grad():
            fields = planned_marks(self.model, self.tool, leaves, path_points=self.path_points, covariates=columns)

        def pull(cotangent: Marks) -> Strokes:
            given = [None if array is None else torch.from_numpy(array) for array in cotangent]
            pairs = [(t, g) for t, g in zip(fields, given, strict=False) if t.requires_grad]
            outputs, cotangents = zip(*pairs, strict=True)
            found = torch.autograd.grad(outputs, leaves, cotangents, allow_unused=True, materialize_grads=True)
            return Strokes(*(gradient.numpy() for gradient in found))

        points, radius, density, softness, paint, *pickup = (f.detach().contiguous().numpy() for f in fields)
        return Marks(points, radius, density, softness, paint, pickup[0] if pickup else None), pull

    def gain(self, places_m: Array) -> Array | None:
        """See ``planning.strokes.brush.Brush``: each place is seen as a picture of one pixel."""
        if not self._camera:
            return None
        places = torch.from_numpy(places_m)
        half = 0.5 / _PIXELS_PER_M
        view = View(places + torch.tensor([-half, half]), torch.full((len(places),), _PIXELS_PER_M))
        image = torch.ones(len(places), 1, 1, 3)
        with torch.no_grad():
            for mechanism in self._camera:
                image = mechanism.camera(image, view)
        return image[:, 0, 0].contiguous().numpy()
