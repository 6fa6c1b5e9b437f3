"""A stroke model with its mechanisms as graphs: marks of planned strokes, their gradients, and the camera's gain."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Final

import torch
from torch import Tensor

from pentimento.bundle.manifest import BrushFacts
from pentimento.deploy.graphs import Graph, compared, export, generator
from pentimento.dynamics.strokes.extended import StrokeModel
from pentimento.dynamics.strokes.planned import (
    BezierTensors,
    commanded_paths,
    depletion_of,
    marks_of_paths,
    planned_marks,
)
from pentimento.dynamics.strokes.simulation import Mechanism, View
from pentimento.robots.tools import Tool

STROKES: Final = {
    "middle_m": "m, canvas frame",
    "theta_rad": "rad",
    "length_m": "m",
    "bend_m": "m",
    "press_m": "m, at start, middle, end",
    "color": "linear light",
}
"""Fields of `planning.strokes.bezier.Strokes` in their order, with their units."""
PATHS: Final = {"path": "t_s, x_m, y_m, z_m, yaw_rad, canvas frame", "color": "linear light"}
"""Strokes of any shape: arguments of `planning.strokes.brush.PathBrush.path_marks` in their order, with their units."""
MARKS: Final = {
    "points_m": "m, canvas frame",
    "radius_m": "m",
    "density": "1",
    "softness": "1",
    "paint": "linear light",
    "pickup": "1",
}
"""Fields of `planning.strokes.brush.Marks` in their order. Colour is both an input and an output; the output is named
paint.
"""

_EXAMPLE_STROKES: Final = 7  # differs from every other size, so that the exporter does not confuse them
_COMPARED_WITH: Final = (1, 2, 40)  # numbers of strokes
_PIXELS_PER_M: Final = 1e4  # of the pictures of one pixel by which the camera's gain is read


def brush_graphs(
    name: str,
    model: StrokeModel,
    tool: Tool,
    *,
    path_points: int,
    canvas_m: tuple[float, float],
    tolerance: float,
    takes_paths: bool = False,
) -> tuple[BrushFacts, dict[str, Graph]]:
    """Facts and graphs by which the lean core plans the strokes of a tool, for paths of `path_points` points.

    Args:
        takes_paths: the graphs are of commanded paths (`PATHS`) rather than of Bézier strokes (`STROKES`).

    Raises:
        ParityError: a graph does not compute what PyTorch does.
    """
    kind = _PathBrush if takes_paths else _BezierBrush
    brush = kind(name, model, tool, path_points, canvas_m)
    found = list(MARKS)[: len(brush.marks(*brush.examples(2)))]
    inputs = [*brush.fields, *brush.columns]
    units = brush.fields | dict.fromkeys(brush.columns, "as in the strokes contract") | MARKS
    units |= {f"of_{mark}": f"d loss / d {mark}" for mark in MARKS}
    units |= {f"to_{key}": f"d loss / d {key}" for key in brush.fields}
    forward = export(
        brush.marks, brush.examples(_EXAMPLE_STROKES), inputs, outputs=found, free=[{0: "strokes"}] * len(inputs)
    )
    backward = export(
        brush.pull,
        brush.pull_examples(_EXAMPLE_STROKES),
        [*inputs, *(f"of_{mark}" for mark in found)],
        outputs=[f"to_{key}" for key in brush.fields],
        free=[{0: "strokes"}] * (len(inputs) + len(found)),
    )
    graphs = {
        key: compared(
            key, exported, function, examples=[examples(count) for count in _COMPARED_WITH], units=units,
            tolerance=tolerance, models=(f"stroke_{tool.name}",),
        )
        for key, exported, function, examples in (
            (f"{name}_marks", forward, brush.marks, brush.examples),
            (f"{name}_pull", backward, brush.pull, brush.pull_examples),
        )
    }  # fmt: skip
    camera = [mechanism for mechanism in model.mechanisms if type(mechanism).camera is not Mechanism.camera]
    if camera:
        graphs[f"{name}_gain"] = _gain_graph(f"{name}_gain", camera, tool, canvas_m=canvas_m, tolerance=tolerance)
    facts = BrushFacts(
        tool.name,
        path_points,
        dict(model.fitted),
        model.timing,
        depletion_of(model),
        picks_up="pickup" in found,
        has_gain=bool(camera),
    )
    return facts, graphs


@dataclass(frozen=True, eq=False)
class _Brush(ABC):
    """The exported functions of a stroke model, with example arguments."""

    fields: ClassVar[dict[str, str]]
    """What a stroke is given by, with units."""
    name: str
    model: StrokeModel
    tool: Tool
    path_points: int
    canvas_m: tuple[float, float]

    @property
    def columns(self) -> list[str]:
        """Covariates that strokes inherit."""
        return sorted(self.model.fitted)

    def marks(self, *arguments: Tensor) -> tuple[Tensor, ...]:
        """`MARKS` of strokes [S], given as `fields` and the covariates `columns`."""
        fields = len(self.fields)
        return self.marks_of(arguments[:fields], dict(zip(self.columns, arguments[fields:], strict=True)))

    @abstractmethod
    def marks_of(self, strokes: Sequence[Tensor], inherited: Mapping[str, Tensor]) -> tuple[Tensor, ...]:
        """`marks` of strokes given as `fields`."""

    def pull(self, *arguments: Tensor) -> tuple[Tensor, ...]:
        """Gradients in `fields`, given the arguments of `marks` and a cotangent for each of its results."""
        fields = len(self.fields)
        known = fields + len(self.columns)
        leaves = [argument.detach().requires_grad_(True) for argument in arguments[:fields]]
        with torch.enable_grad():
            marks = self.marks(*leaves, *arguments[fields:known])
        pairs = [pair for pair in zip(marks, arguments[known:], strict=True) if pair[0].requires_grad]
        outputs, cotangents = zip(*pairs, strict=True)
        return torch.autograd.grad(outputs, leaves, cotangents, allow_unused=True, materialize_grads=True)

    def examples(self, count: int) -> list[Tensor]:
        """Arguments of `marks`: random strokes within the limits of the tool, with random covariates."""
        numbers = generator(self.tool.name, count)
        strokes = self.example_strokes(_bezier_strokes(self.tool, self.canvas_m, count, numbers))
        ends = [self.model.fitted[column].ends for column in self.columns]
        inherited = [low + (high - low) * torch.rand(count, generator=numbers) for low, high in ends]
        for column, values in zip(self.columns, inherited, strict=True):
            if column == "wet_age_s":
                values[::3] = torch.nan  # no paint below
        return [*strokes, *inherited]

    @abstractmethod
    def example_strokes(self, strokes: BezierTensors) -> Sequence[Tensor]:
        """These strokes as `fields`."""

    def pull_examples(self, count: int) -> list[Tensor]:
        """Arguments of `pull`."""
        arguments, numbers = self.examples(count), generator(self.name, count + 1)
        return [*arguments, *(torch.randn(mark.shape, generator=numbers) for mark in self.marks(*arguments))]


class _BezierBrush(_Brush):
    fields = STROKES

    def marks_of(self, strokes: Sequence[Tensor], inherited: Mapping[str, Tensor]) -> tuple[Tensor, ...]:
        bezier = BezierTensors(*strokes)
        return planned_marks(self.model, self.tool, bezier, path_points=self.path_points, covariates=inherited)

    def example_strokes(self, strokes: BezierTensors) -> Sequence[Tensor]:
        return strokes


class _PathBrush(_Brush):
    fields = PATHS

    def marks_of(self, strokes: Sequence[Tensor], inherited: Mapping[str, Tensor]) -> tuple[Tensor, ...]:
        path, color = strokes
        return marks_of_paths(self.model, path, color, inherited)

    def example_strokes(self, strokes: BezierTensors) -> Sequence[Tensor]:
        """Swung from side to side, since the graph is for paths of any shape."""
        path = commanded_paths(strokes, self.path_points, self.tool)
        swing = strokes.bend_m[:, None] * torch.linspace(0.0, 4 * torch.pi, self.path_points).sin()
        across = torch.stack([-strokes.theta_rad.sin(), strokes.theta_rad.cos()], dim=-1)
        path[..., 1:3] += swing[..., None] * across[:, None]
        return path, strokes.color


def _bezier_strokes(
    tool: Tool, canvas_m: tuple[float, float], count: int, numbers: torch.Generator
) -> BezierTensors:  # fmt: skip
    """Random strokes within the limits of the tool."""

    def between(low: float, high: float, *shape: int) -> Tensor:
        return low + (high - low) * torch.rand(*shape, generator=numbers)

    length = between(*tool.stroke_length_m, count)
    return BezierTensors(
        between(0.0, 1.0, count, 2) * torch.tensor(canvas_m),
        between(-torch.pi, torch.pi, count),
        length,
        length * between(*tool.bend_range, count),
        between(*tool.press_range_m, count, 3),
        between(0.0, 1.0, count, 3),
    )


def _gain_graph(
    name: str, camera: Sequence[Mechanism], tool: Tool, *, canvas_m: tuple[float, float], tolerance: float
) -> Graph:
    """The gain of linear light by the camera's mechanisms at places [N, 2] of the canvas."""

    def gain(places: Tensor) -> tuple[Tensor]:
        half = 0.5 / _PIXELS_PER_M
        view = View(places + torch.tensor([-half, half]), torch.full_like(places[:, 0], _PIXELS_PER_M))
        image = torch.ones_like(places[:, :1])[:, None, None].expand(-1, 1, 1, 3)
        for mechanism in camera:
            image = mechanism.camera(image, view)
        return (image[:, 0, 0],)

    def examples(count: int) -> list[Tensor]:
        return [torch.rand(count, 2, generator=generator(name, count)) * torch.tensor(canvas_m)]

    return compared(
        name,
        export(gain, examples(_EXAMPLE_STROKES), ["places_m"], outputs=["gain"], free=[{0: "places"}]),
        gain,
        examples=[examples(count) for count in _COMPARED_WITH],
        units={"places_m": "m, canvas frame", "gain": "1, of linear light"},
        tolerance=tolerance,
        models=(f"stroke_{tool.name}",),
    )
