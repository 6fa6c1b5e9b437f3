"""What a plan is made for, what strokes will look like there, and how far that is from the target."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pentimento.contracts.covariates import fresh_memory
from pentimento.planning.config import PlannerConfig, Slack
from pentimento.planning.memory import Extension, context_of, inherited
from pentimento.planning.objectives.settings import (
    ObjectivesConfig,
    build_objective,
    first_pass_target,
    load_style_picture,
)
from pentimento.planning.objectives.weighted import Objective
from pentimento.planning.strokes import StrokeTensors
from pentimento.robots.tools import Tool
from pentimento.stroke_dynamics.autograd import render_strokes
from pentimento.stroke_dynamics.extended import StrokeModel, picks_up
from pentimento.stroke_dynamics.simulation import Mechanism, View, extended_mark, full_at_most, simulate
from pentimento.stroke_dynamics.traj2stroke import Mark

FloatArray = NDArray[np.float64]
FloatImage = NDArray[np.float32]


@dataclass(frozen=True)
class Scene:
    """What a plan is made for."""

    tool: Tool
    mark: Callable[[Tensor], Mark]
    """The stroke model: paths [S, N, 5] to marks."""
    canvas_size_m: tuple[float, float]
    target: Tensor
    """[H, W, 3], linear light, of the whole canvas."""
    extension: Extension | None = None
    """What the stroke model alone gets wrong, and the state of tool and canvas when the plan begins."""

    @property
    def pixels_per_m(self) -> float:
        """Of the target."""
        return self.target.shape[1] / self.canvas_size_m[0]

    @property
    def view(self) -> View:
        """The whole canvas."""
        return View(torch.tensor([[0.0, self.canvas_size_m[1]]]), torch.tensor([self.pixels_per_m]))

    @property
    def mechanisms(self) -> tuple[Mechanism, ...]:
        """What extends the stroke model."""
        return () if self.extension is None else self.extension.model.mechanisms


def scene_with(model: StrokeModel, tool: Tool, canvas_size_m: tuple[float, float], target: Tensor) -> Scene:
    """A blank canvas at a session's start, seen through a stroke model with what extends it."""
    memory = fresh_memory(canvas_size_m, tool.nominal_width_m)
    extension = Extension(model, memory, clock_s=0.0, made=0) if model.mechanisms else None
    return Scene(tool, model.mark(), canvas_size_m, target, extension)


def coarser(
    scene: Scene, canvas: Tensor, config: PlannerConfig, factor: int = 2
) -> tuple[Scene, Tensor, PlannerConfig]:
    """The same task at a ``factor``-th of the resolution: light averaged over pixels, viewing distances shrunk."""
    height, width = (max(round(length / factor), 1) for length in scene.target.shape[:2])

    def shrunk(image: Tensor) -> Tensor:
        return torch.from_numpy(cv2.resize(image.numpy(), (width, height), interpolation=cv2.INTER_AREA))

    distances = tuple(dict.fromkeys(max(distance // factor, 1) for distance in config.distances_px))
    return (
        replace(scene, target=shrunk(scene.target)),
        shrunk(canvas),
        replace(config, distances_px=distances, pixels_per_m=config.pixels_per_m / factor),
    )


def marks_px(strokes: StrokeTensors, scene: Scene, path_points: int) -> tuple[Tensor, Tensor, Mark]:
    """Points [S, N, 2] (column, row) and radii [S, N] in the target's pixels, and the marks as the model gives them."""
    context = context_of(strokes, scene.tool, scene.extension, path_points)
    mark = Mark(*(values[0] for values in full_at_most(extended_mark(scene.mark, scene.mechanisms, context))))
    return scene.view.to_pixels(mark.points_m[None])[0], mark.radius_m * scene.pixels_per_m, mark


def inherit(strokes: StrokeTensors, scene: Scene, path_points: int) -> dict[str, Tensor] | None:
    """What the strokes, in their order, inherit where the scene begins, to be kept while they move a little."""
    if scene.extension is None:
        return None
    return inherited(strokes, scene.tool, scene.extension, path_points, scene.extension.model.fitted)


class Mishap(NamedTuple):
    """What befalls each stroke in execution."""

    narrowing: Tensor
    """[S, 1], the width that is left, as a share."""
    shift_m: Tensor
    """[S, 1, 2], canvas frame."""


def expected_mishap(strokes: int, slack: Slack) -> Mishap:
    """What befalls a stroke on average."""
    return Mishap(torch.full((strokes, 1), 1 - slack.thinning / 2), torch.zeros(strokes, 1, 2))


def mishaps(strokes: int, slack: Slack, rng: torch.Generator) -> Mishap:
    """One draw for each stroke."""
    return Mishap(
        1 - slack.thinning * torch.rand(strokes, 1, generator=rng),
        slack.shift_m * torch.randn(strokes, 1, 2, generator=rng),
    )


def render_plan(
    strokes: StrokeTensors, canvas: Tensor, scene: Scene, path_points: int, mishap: Mishap | None = None
) -> Tensor:
    """What the canvas [H, W, 3] (linear light) will look like after the strokes; differentiable."""
    if len(strokes) == 0:
        return canvas
    context, color = context_of(strokes, scene.tool, scene.extension, path_points), strokes.color[None]

    def mark(path: Tensor) -> Mark:
        meant = scene.mark(path)
        if mishap is None:
            return meant
        return meant._replace(points_m=meant.points_m + mishap.shift_m, radius_m=meant.radius_m * mishap.narrowing)

    if picks_up(scene.mechanisms, color.detach(), context):
        canvas = torch.cat([canvas, _wetness(scene)[..., None]], dim=-1)
    return simulate(mark, scene.mechanisms, context, color, canvas[None], scene.view)[0]


def _wetness(scene: Scene) -> Tensor:
    """[H, W], 0 to 1: where there is paint when the plan begins, from the canvas as it is remembered."""
    height, width = scene.target.shape[:2]
    if scene.extension is None:
        return torch.zeros(height, width)
    ink = scene.extension.memory.ink.astype(np.float32)
    return torch.from_numpy(cv2.resize(ink, (width, height), interpolation=cv2.INTER_LINEAR))


def render_fixed(strokes: StrokeTensors, canvas: Tensor, scene: Scene, path_points: int) -> FloatImage:
    """``render_plan`` as numbers, without gradients."""
    with torch.no_grad():
        return render_plan(strokes, canvas, scene, path_points).numpy()


def coverages(strokes: StrokeTensors, scene: Scene, path_points: int, width_px: int) -> FloatArray:
    """[S, P] how much each stroke alone covers each pixel of a picture ``width_px`` wide, 0 to 1."""
    height, width = scene.target.shape[:2]
    factor = max(width / width_px, 1.0)
    small = replace(scene, target=torch.zeros(max(round(height / factor), 1), max(round(width / factor), 1), 3))
    with torch.no_grad():
        points, radius, mark = marks_px(strokes, small, path_points)
        white, black = torch.ones(len(strokes), 1, 3), torch.zeros(len(strokes), *small.target.shape)
        alone = render_strokes(
            points[:, None], radius[:, None], mark.density[:, None], mark.softness[:, None], white, black
        )
    return alone[..., 0].flatten(1).double().numpy()


def objective_for(scene: Scene, config: PlannerConfig) -> Objective:
    """What the planner lowers: an image [H, W, 3] in linear light to a scalar."""
    return build_objective(config.objectives, scene.target, _style(scene, config), config.distances_px, config.seed)


def first_pass(scene: Scene, config: PlannerConfig) -> tuple[Scene, PlannerConfig]:
    """The task before the whole sum of objectives takes over: a likeness, by print objective alone (thesis 4.5.3)."""
    target = first_pass_target(config.objectives, scene.target, _style(scene, config))
    return replace(scene, target=target), replace(config, objectives=ObjectivesConfig(1.0, None))


def _style(scene: Scene, config: PlannerConfig) -> Tensor | None:
    style = config.objectives.style
    if style is None:
        return None
    height, width = scene.target.shape[:2]
    return load_style_picture(style, (height, width))


class ErrorMap:
    """[H, W] squared difference of lightness between images and a target, averaged over viewing distances.

    The print objective's integrand, near enough to compare strokes by: sRGB's curve is close to a square root.
    """

    def __init__(self, target: Tensor, distances_px: tuple[int, ...]) -> None:
        """Hold what there is to see of ``target``, [H, W, 3] in linear light."""
        self._seen = [(distance, _lightness(target.numpy(), distance)) for distance in distances_px]
        self._mean = np.full(3, 1 / (3 * len(distances_px)), np.float32)

    def __call__(self, image: FloatImage) -> FloatImage:
        """For an image [H, W, 3] in linear light."""
        return np.asarray(
            sum((np.square(_lightness(image, distance) - target) @ self._mean) for distance, target in self._seen)
        )


def _lightness(image: FloatImage, distance_px: int) -> FloatImage:
    seen = cv2.blur(image, (distance_px, distance_px)) if distance_px > 1 else image
    return np.asarray(np.sqrt(np.maximum(seen, 0.0)), dtype=np.float32)
