"""What a plan is made for, and how far a picture is from what is wanted there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.covariates import fresh_memory
from pentimento.contracts.errors import ConfigError
from pentimento.planning.objectives import Objective, PrintObjective, Term, WeightedObjective
from pentimento.planning.strokes.brush import Brush
from pentimento.planning.strokes.config import ObjectivesConfig, PlannerConfig
from pentimento.planning.strokes.memory import Commanded, Start, inherited
from pentimento.robots.tools import Tool

Array = NDArray[np.float32]


class Style(Protocol):
    """What a painting should be made of, wherever it is (thesis 4.3.4); the workshop has one."""

    def picture(self, shape: tuple[int, int]) -> Array:
        """The picture whose style it is, linear light [H, W, 3] at this height and width."""

    def objective(self, shape: tuple[int, int]) -> Objective:
        """How far an image of this height and width is from the style."""


@dataclass(frozen=True, eq=False)
class Scene:
    """What a plan is made for."""

    tool: Tool
    brush: Brush
    """How strokes come out."""
    canvas_size_m: tuple[float, float]
    target: Array
    """[H, W, 3], linear light, of the whole canvas."""
    start: Start
    """The state of tool and canvas when the plan begins."""
    style: Style | None = None
    """For plans whose ``objectives`` ask for one."""
    threads: int = 1
    """How many render at once; plans are the same for any number."""

    @property
    def pixels_per_m(self) -> float:
        """Of the target."""
        return self.target.shape[1] / self.canvas_size_m[0]

    @cached_property
    def gain(self) -> Array | None:
        """[H, W, 3] by what the camera multiplies the light of each pixel; None where it does not."""
        height, width = self.target.shape[:2]
        x = (np.arange(width) + 0.5) / self.pixels_per_m
        y = self.canvas_size_m[1] - (np.arange(height) + 0.5) / self.pixels_per_m
        places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2).astype(np.float32)
        gain = self.brush.gain(places)
        return None if gain is None else gain.reshape(height, width, 3)


def scene_with(
    brush: Brush, tool: Tool, canvas_size_m: tuple[float, float], target: Array, style: Style | None = None
) -> Scene:
    """A blank canvas at a session's start."""
    start = Start(fresh_memory(canvas_size_m, tool.nominal_width_m), clock_s=0.0, made=0)
    return Scene(tool, brush, canvas_size_m, target, start, style)


def coarser(scene: Scene, canvas: Array, config: PlannerConfig, factor: int = 2) -> tuple[Scene, Array, PlannerConfig]:
    """The same task at a ``factor``-th of the resolution: light averaged over pixels, viewing distances shrunk."""
    height, width = (max(round(length / factor), 1) for length in scene.target.shape[:2])

    def shrunk(image: Array) -> Array:
        return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), dtype=np.float32)

    distances = tuple(dict.fromkeys(max(distance // factor, 1) for distance in config.distances_px))
    return (
        replace(scene, target=shrunk(scene.target)),
        shrunk(canvas),
        replace(config, distances_px=distances, pixels_per_m=config.pixels_per_m / factor),
    )


def inherit(strokes: Commanded, scene: Scene) -> dict[str, Array]:
    """What the strokes, in their order, inherit where the scene begins, to be kept while they move a little."""
    return inherited(strokes, scene.tool, scene.brush, scene.start)


def objective_for(scene: Scene, config: PlannerConfig) -> WeightedObjective:
    """What the planner lowers.

    Raises:
        ConfigError: the picture is smaller than a viewing distance, or a style is asked for that the scene has not.
    """
    wanted, terms = config.objectives, []
    if wanted.print_weight > 0:
        terms.append(Term("print", wanted.print_weight, PrintObjective(scene.target, config.distances_px)))
    if wanted.style is not None:
        terms.append(Term("style", wanted.style.weight, _style_of(scene).objective(_shape(scene))))
    return WeightedObjective(tuple(terms))


def first_pass(scene: Scene, config: PlannerConfig) -> tuple[Scene, PlannerConfig]:
    """The task before the whole sum of objectives takes over: a likeness, by print objective alone (thesis 4.5.3).

    Style says what things are made of, not where they are. Where the print objective has no weight, nothing else
    composes the picture, so the plan starts as a copy of the style picture and is adapted from there; otherwise it
    starts as a copy of the target.
    """
    target = scene.target
    if config.objectives.print_weight == 0:
        target = _style_of(scene).picture(_shape(scene))
    return replace(scene, target=target), replace(config, objectives=ObjectivesConfig(1.0, None))


def _style_of(scene: Scene) -> Style:
    if scene.style is None:
        raise ConfigError(
            "The planner's objectives ask for a style, but the scene that is planned for has none: a style is looked "
            "at through networks that only the workshop has. Set objectives.style to null, or plan in the workshop."
        )
    return scene.style


def _shape(scene: Scene) -> tuple[int, int]:
    height, width = scene.target.shape[:2]
    return height, width
