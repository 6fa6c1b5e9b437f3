"""A drawing of shaped strokes: planned, executed by a robot and photographed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.calibration.observe import CameraCalibration
from pentimento.contracts.colour import linear_to_srgb, to_uint8
from pentimento.contracts.covariates import fresh_memory
from pentimento.contracts.plan import PlannedStroke
from pentimento.control.execute import Session, execute
from pentimento.control.painter import as_linear, observe
from pentimento.dynamics.strokes.planned import TorchBrush
from pentimento.dynamics.strokes.simulation import StrokeContext, extended_mark, full_at_most
from pentimento.planning.strokes.brush import Array, Marks
from pentimento.planning.strokes.config import Log, ShapedPlanConfig
from pentimento.planning.strokes.planner import plan_shapes
from pentimento.planning.strokes.render_plan import render_plan
from pentimento.planning.strokes.scene import Scene
from pentimento.planning.strokes.shapes import Shapes, planned_strokes
from pentimento.robots.driver import Robot

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Drawing:
    """A plan and its execution."""

    planned: list[PlannedStroke]
    measured_m: list[FloatArray]
    """[N, 2] of each stroke: the path of the tip, canvas frame, as the robot measured it."""
    photo: Image
    """sRGB [H, W, 3]."""
    predicted: Image
    """sRGB [H, W, 3]."""


def draw_shapes(
    robot: Robot, calibration: CameraCalibration, scene: Scene, *, shapes: Shapes, ink_m: float,
    config: ShapedPlanConfig, log: Log,
) -> Drawing:  # fmt: skip
    """Draw the scene's target with about ``ink_m`` metres of line, on the sheet in front of the robot."""
    canvas = as_linear(observe(robot, calibration, config.pixels_per_m))
    strokes = plan_shapes(canvas, scene, shapes, ink_m, config=config, log=log)
    predicted = linear_to_srgb(np.clip(render_plan(strokes, canvas, scene), 0.0, 1.0))
    planned = planned_strokes(strokes, scene.tool)
    memory = fresh_memory(robot.canvas_size_m, scene.tool.nominal_width_m)
    ink = np.array([scene.tool.color_srgb], dtype=np.float64)
    _, measured = execute(
        robot, scene.tool, planned, palette_srgb=ink, memory=memory, session=Session("drawing", robot.clock_s)
    )
    photo = observe(robot, calibration, config.pixels_per_m)
    return Drawing(planned, [_known(path) for path in measured], photo, to_uint8(predicted))


def _known(path: FloatArray) -> FloatArray:
    place = path[:, 1:3]
    return place[np.isfinite(place).all(axis=1)]


class TorchPathBrush(TorchBrush):
    """A stroke model as a ``planning.strokes.brush.Brush`` that also takes paths of any shape (``PathBrush``)."""

    def path_marks(
        self, paths: Array, color: Array, inherited: Mapping[str, Array]
    ) -> tuple[Marks, Callable[[Marks], Array]]:
        """See ``PathBrush``. Gradients treat times as constants. The pull-back may be called once."""
        path = torch.tensor(paths, requires_grad=True)
        columns = {name: torch.tensor(inherited[name])[None] for name in self.fitted}
        with torch.enable_grad():
            context = StrokeContext(path[None], columns)
            mark = full_at_most(extended_mark(self.model.mark(), self.model.mechanisms, context))
            paint, pickup = torch.tensor(color)[None], None
            for mechanism in self.model.mechanisms:
                paint, pickup = mechanism.composite(paint, pickup, context)
            fields = [values[0] for values in (*mark, paint)]
            wet = None if pickup is None else pickup[0]

        def pull(cotangent: Marks) -> Array:
            pairs = [
                (field, torch.from_numpy(given))
                for field, given in zip((*fields, wet), cotangent, strict=True)
                if field is not None and field.requires_grad and given is not None
            ]
            outputs, cotangents = zip(*pairs, strict=True)
            return torch.autograd.grad(outputs, path, cotangents)[0].numpy()

        points, radius, density, softness, color_left = (f.detach().contiguous().numpy() for f in fields)
        picked = None if wet is None else wet.detach().contiguous().numpy()
        return Marks(points, radius, density, softness, color_left, picked), pull
