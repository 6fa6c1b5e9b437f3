"""A drawing of shaped strokes: planned, executed by a robot and photographed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.calibration.observe import CameraCalibration
from pentimento.contracts.plan import PlannedStroke
from pentimento.control.painter import as_linear, observe, paint
from pentimento.dynamics.strokes.planned import TorchBrush, marks_of_paths
from pentimento.planning.strokes.brush import Array, Marks
from pentimento.planning.strokes.config import Log, ShapedPlanConfig, no_log
from pentimento.planning.strokes.planner import plan_shapes
from pentimento.planning.strokes.scene import Scene
from pentimento.planning.strokes.shapes import Shapes
from pentimento.robots.driver import Robot

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Drawing:
    """A plan and its execution."""

    executed: list[PlannedStroke]
    palette_srgb: FloatArray
    """[K, 3] paints, or the tool's ink."""
    measured_m: list[FloatArray]
    """[N, 2] of each stroke: the path of the tip, canvas frame, as the robot measured it."""
    photo: Image
    """sRGB [H, W, 3]."""
    predicted: Image
    """By the first plan, sRGB [H, W, 3]."""


def draw_shapes(
    robot: Robot, calibration: CameraCalibration, scene: Scene, *, shapes: Shapes, ink_m: float, replan_every: int,
    config: ShapedPlanConfig, log: Log,
) -> Drawing:  # fmt: skip
    """Draw the scene's target with about ``ink_m`` metres of line, on the sheet in front of the robot.

    The remaining strokes are planned again after each ``replan_every`` strokes.
    """
    canvas = as_linear(observe(robot, calibration, config.pixels_per_m))
    strokes, palette = plan_shapes(canvas, scene, shapes, ink_m, config=config, log=log)
    painting = paint(
        robot, scene, strokes, palette_srgb=palette, replan_every=replan_every, replan=True, config=config, log=no_log
    )
    measured = [_known(path) for path in painting.measured]
    return Drawing(painting.executed, palette, measured, painting.photos[-1], painting.predicted)


def _known(path: FloatArray) -> FloatArray:
    place = path[:, 1:3]
    return place[np.isfinite(place).all(axis=1)]


class TorchPathBrush(TorchBrush):
    """A stroke model as a ``planning.strokes.brush.Brush`` that also takes paths of any shape (``PathBrush``)."""

    def path_marks(
        self, paths: Array, color: Array, inherited: Mapping[str, Array]
    ) -> tuple[Marks, Callable[[Marks], tuple[Array, Array]]]:
        """See ``PathBrush``. Gradients treat times as constants. The pull-back may be called once."""
        path, own = torch.tensor(paths, requires_grad=True), torch.tensor(color, requires_grad=True)
        columns = {name: torch.tensor(inherited[name]) for name in self.fitted}
        with torch.enable_grad():
            fields = marks_of_paths(self.model, path, own, columns)

        def pull(cotangent: Marks) -> tuple[Array, Array]:
            pairs = [
                (field, torch.from_numpy(given))
                for field, given in zip(fields, cotangent, strict=False)  # no pickup where tools stay clean
                if field.requires_grad and given is not None
            ]
            outputs, cotangents = zip(*pairs, strict=True)
            found = torch.autograd.grad(outputs, (path, own), cotangents, allow_unused=True, materialize_grads=True)
            return found[0].numpy(), found[1].numpy()

        points, radius, density, softness, paint, *pickup = (f.detach().contiguous().numpy() for f in fields)
        return Marks(points, radius, density, softness, paint, pickup[0] if pickup else None), pull
