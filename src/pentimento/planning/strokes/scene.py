"""What a plan is made for: tool, stroke model, canvas, target; and the objective there."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.covariates import fresh_memory
from pentimento.contracts.errors import ConfigError
from pentimento.planning.objectives import Objective, PrintObjective, Term, WeightedObjective
from pentimento.planning.strokes.brush import Brush
from pentimento.planning.strokes.config import PlanConfig
from pentimento.planning.strokes.memory import Start, inherited
from pentimento.planning.strokes.paths import PlannedPaths
from pentimento.robots.tools import Tool

Array = NDArray[np.float32]


class Style(Protocol):
    """The style of a picture, wherever its parts are (thesis 4.3.4). The workshop and a bundle implement it."""

    def objective(self, shape: tuple[int, int]) -> Objective:
        """How far an image of this height and width is from the style."""


class Meaning(Protocol):
    """What a text-image encoder sees, wherever it runs (thesis 4.3.4). The workshop and a bundle implement it."""

    def text(self, words: str, shape: tuple[int, int]) -> Objective:
        """How far an image of this height and width is from the words (eq. 4.1)."""

    def semantic(self, target: Array) -> Objective:
        """How far what is seen in an image is from what is seen in a target [H, W, 3], linear light (eq. 4.4)."""


@dataclass(frozen=True, eq=False)
class Scene:
    """What a plan is made for."""

    tool: Tool
    brush: Brush
    """The stroke model."""
    canvas_size_m: tuple[float, float]
    target: Array
    """[H, W, 3], linear light, of the whole canvas. Plans for words or a style alone start from it."""
    start: Start
    """State of tool and canvas when the plan begins."""
    style: Style | None = None
    """For plans whose ``objectives`` include a style."""
    meaning: Meaning | None = None
    """For plans whose ``objectives`` include words or what is seen in the target."""
    threads: int = 1
    """Threads of the renderer; the result does not depend on their number."""

    @property
    def pixels_per_m(self) -> float:
        """Resolution of the target."""
        return self.target.shape[1] / self.canvas_size_m[0]

    @cached_property
    def gain(self) -> Array | None:
        """[H, W, 3] factor of the camera on the light of each pixel. None: no camera mechanism."""
        height, width = self.target.shape[:2]
        x = (np.arange(width) + 0.5) / self.pixels_per_m
        y = self.canvas_size_m[1] - (np.arange(height) + 0.5) / self.pixels_per_m
        places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2).astype(np.float32)
        gain = self.brush.gain(places)
        return None if gain is None else gain.reshape(height, width, 3)


def scene_with(
    brush: Brush,
    tool: Tool,
    canvas_size_m: tuple[float, float],
    target: Array,
    style: Style | None = None,
    meaning: Meaning | None = None,
) -> Scene:
    """A scene with a blank canvas at the start of a session."""
    start = Start(fresh_memory(canvas_size_m, tool.nominal_width_m), clock_s=0.0, made=0)
    return Scene(tool, brush, canvas_size_m, target, start, style, meaning)


def halved(image: Array) -> Array:
    """An image [H, W, 3] at half the resolution: light is averaged over pixels."""
    height, width = (max(round(length / 2), 1) for length in image.shape[:2])
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), dtype=np.float32)


def inherit(strokes: PlannedPaths, scene: Scene) -> dict[str, Array]:
    """The covariates that strokes inherit in this order from the scene's start; see ``memory.inherited``."""
    return inherited(strokes, scene.tool, scene.brush, scene.start)


def objective_for(scene: Scene, config: PlanConfig) -> WeightedObjective:
    """The weighted sum that the planner minimises.

    Raises:
        ConfigError: the picture is smaller than a viewing distance, or the objectives include a style, words or what is
            seen in the target, and the scene has no networks that see it.
    """
    wanted, terms = config.objectives, []
    if wanted.print_weight > 0:
        terms.append(Term("print", wanted.print_weight, PrintObjective(scene.target, config.distances_px)))
    if wanted.semantic_weight > 0:
        terms.append(Term("semantic", wanted.semantic_weight, _meaning_of(scene).semantic(scene.target)))
    if wanted.text is not None:
        terms.append(Term("text", wanted.text.weight, _meaning_of(scene).text(wanted.text.words, _shape(scene))))
    if wanted.style is not None:
        terms.append(Term("style", wanted.style.weight, _style_of(scene).objective(_shape(scene))))
    return WeightedObjective(tuple(terms))


def _style_of(scene: Scene) -> Style:
    if scene.style is None:
        raise ConfigError(
            "The planner's objectives include a style, but the scene has none: the networks that see a style are part "
            "of the workshop only. Set objectives.style to null, or plan in the workshop."
        )
    return scene.style


def _meaning_of(scene: Scene) -> Meaning:
    if scene.meaning is None:
        raise ConfigError(
            "The planner's objectives include text or semantic_weight, but the scene has no encoder. Set "
            "objectives.text to null and objectives.semantic_weight to 0, or plan with an encoder."
        )
    return scene.meaning


def _shape(scene: Scene) -> tuple[int, int]:
    height, width = scene.target.shape[:2]
    return height, width
