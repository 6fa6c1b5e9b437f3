"""A stroke model with its mechanisms as graphs: marks of planned strokes, their gradients, and the camera's gain."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from pentimento.bundle.manifest import BrushFacts
from pentimento.deploy.graphs import Graph, compared, export, generator
from pentimento.dynamics.strokes.extended import StrokeModel
from pentimento.dynamics.strokes.planned import planned_marks
from pentimento.dynamics.strokes.simulation import Mechanism, View
from pentimento.robots.tools import Tool

STROKES = {
    "middle_m": "m, canvas frame",
    "theta_rad": "rad",
    "length_m": "m",
    "bend_m": "m",
    "press_m": "m, at start, middle, end",
    "color": "linear light",
}
"""Fields of ``planning.strokes.bezier.Strokes`` in their order, with their units."""
MARKS = {
    "points_m": "m, canvas frame",
    "radius_m": "m",
    "density": "1",
    "softness": "1",
    "paint": "linear light",
    "pickup": "1",
}
"""Fields of ``planning.strokes.brush.Marks`` in their order. Colour goes in and comes out, so here it is paint."""

_EXAMPLE_STROKES = 7  # unlike every other size of a stroke, so that the exporter takes it for none of them
_COMPARED_WITH = (1, 2, 40)
_PIXELS_PER_M = 1e4  # of the pictures of one pixel in which a camera's gain is read


def brush_graphs(
    name: str, model: StrokeModel, tool: Tool, path_points: int, canvas_m: tuple[float, float], tolerance: float
) -> tuple[BrushFacts, dict[str, Graph]]:
    """What a runner plans a tool's strokes with, for paths of so many points.

    Raises:
        ParityError: a graph does not compute what PyTorch does.
    """
    columns = sorted(model.fitted)
    fields = len(STROKES)

    def marks(*arguments: Tensor) -> tuple[Tensor, ...]:
        inherited = dict(zip(columns, arguments[fields:], strict=True))
        middle, theta, length, bend, press, color = arguments[:fields]
        return planned_marks(model, tool, path_points, middle, theta, length, bend, press, color, inherited)

    def pull(*arguments: Tensor) -> tuple[Tensor, ...]:
        known = fields + len(columns)
        leaves = [argument.detach().requires_grad_(True) for argument in arguments[:fields]]
        with torch.enable_grad():
            made = marks(*leaves, *arguments[fields:known])
        pairs = [pair for pair in zip(made, arguments[known:], strict=True) if pair[0].requires_grad]
        outputs, cotangents = zip(*pairs, strict=True)
        return torch.autograd.grad(outputs, leaves, cotangents, allow_unused=True, materialize_grads=True)

    def examples(count: int) -> list[Tensor]:
        return _strokes(model, tool, canvas_m, columns, count)

    def pulled(count: int) -> list[Tensor]:
        arguments = examples(count)
        numbers = generator(name, count + 1)
        return [*arguments, *(torch.randn(mark.shape, generator=numbers) for mark in marks(*arguments))]

    found = list(MARKS)[: len(marks(*examples(2)))]
    inputs = [*STROKES, *columns]
    units = STROKES | dict.fromkeys(columns, "as in the strokes contract") | MARKS
    units |= {f"of_{mark}": f"d loss / d {mark}" for mark in MARKS} | {
        f"to_{key}": f"d loss / d {key}" for key in STROKES
    }
    open_strokes = [{0: "strokes"}] * len(inputs)
    graphs = {
        f"{name}_marks": compared(
            f"{name}_marks",
            export(marks, examples(_EXAMPLE_STROKES), inputs, found, open_strokes),
            marks,
            [examples(count) for count in _COMPARED_WITH],
            units,
            tolerance,
            (f"stroke_{tool.name}",),
        ),
        f"{name}_pull": compared(
            f"{name}_pull",
            export(
                pull,
                pulled(_EXAMPLE_STROKES),
                [*inputs, *(f"of_{mark}" for mark in found)],
                [f"to_{key}" for key in STROKES],
                [{0: "strokes"}] * (len(inputs) + len(found)),
            ),
            pull,
            [pulled(count) for count in _COMPARED_WITH],
            units,
            tolerance,
            (f"stroke_{tool.name}",),
        ),
    }
    camera = [mechanism for mechanism in model.mechanisms if type(mechanism).camera is not Mechanism.camera]
    if camera:
        graphs[f"{name}_gain"] = _gain_graph(f"{name}_gain", camera, tool, canvas_m, tolerance)
    facts = BrushFacts(
        tool.name, path_points, dict(model.fitted), model.timing, picks_up="pickup" in found, has_gain=bool(camera)
    )
    return facts, graphs


def _strokes(
    model: StrokeModel, tool: Tool, canvas_m: tuple[float, float], columns: Sequence[str], count: int
) -> list[Tensor]:
    """Strokes that the tool can make, anywhere, and what they may inherit."""
    numbers = generator(tool.name, count)

    def between(low: float, high: float, *shape: int) -> Tensor:
        return low + (high - low) * torch.rand(*shape, generator=numbers)

    length = between(*tool.stroke_length_m, count)
    strokes = [
        between(0.0, 1.0, count, 2) * torch.tensor(canvas_m),
        between(-torch.pi, torch.pi, count),
        length,
        length * between(*tool.bend_range, count),
        between(*tool.press_range_m, count, 3),
        between(0.0, 1.0, count, 3),
    ]
    inherited = [between(*model.fitted[column].ends, count) for column in columns]
    for column, values in zip(columns, inherited, strict=True):
        if column == "wet_age_s":
            values[::3] = torch.nan  # bare ground below
    return [*strokes, *inherited]


def _gain_graph(
    name: str, camera: Sequence[Mechanism], tool: Tool, canvas_m: tuple[float, float], tolerance: float
) -> Graph:
    def gain(places: Tensor) -> tuple[Tensor]:
        half = 0.5 / _PIXELS_PER_M
        view = View(places + torch.tensor([-half, half]), torch.full_like(places[:, 0], _PIXELS_PER_M))
        image = torch.ones_like(places[:, :1])[:, None, None].expand(-1, 1, 1, 3)
        for mechanism in camera:
            image = mechanism.camera(image, view)
        return (image[:, 0, 0],)

    def examples(count: int) -> list[Tensor]:
        return [torch.rand(count, 2, generator=generator(name, count)) * torch.tensor(canvas_m)]

    model = export(gain, examples(_EXAMPLE_STROKES), ["places_m"], ["gain"], [{0: "places"}])
    units = {"places_m": "m, canvas frame", "gain": "1, of linear light"}
    compare = [examples(count) for count in _COMPARED_WITH]
    return compared(name, model, gain, compare, units, tolerance, (f"stroke_{tool.name}",))
