"""Plans of strokes for a goal picture, a scene or a text by the Low-Level Action Planner (thesis 6.4)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb, srgb_to_linear, to_float, to_uint8
from pentimento.contracts.ranges import above_zero
from pentimento.copainting.scenes.ink import InkTones, check_ink, ink_tones
from pentimento.dynamics.strokes.extended import StrokeModel, read_stroke_model
from pentimento.dynamics.strokes.planned import TorchBrush
from pentimento.planning.strokes.bezier import Strokes, no_strokes, with_color
from pentimento.planning.strokes.config import PlannerConfig, no_log
from pentimento.planning.strokes.descent import descend
from pentimento.planning.strokes.initialise import random_strokes
from pentimento.planning.strokes.planner import plan
from pentimento.planning.strokes.relocate import without_useless
from pentimento.planning.strokes.render_plan import render_plan
from pentimento.planning.strokes.scene import Scene, scene_with
from pentimento.robots.tools import Tool, load_tool
from pentimento.semantics.encoder import Encoder
from pentimento.semantics.objective import TextObjective, TorchObjective
from pentimento.semantics.style import style_of

Light = NDArray[np.float32]
Picture = NDArray[np.uint8]

_GROUND_RANGE = 0.03  # of linear light around a picture's most common colour: its ground


@dataclass(frozen=True)
class Medium:
    """A tool on a square sheet, and its planner."""

    tool: str
    side_m: float
    """Of the sheet."""
    words: str
    """What a request to the goal planner says of the medium."""
    ink: InkTones | None
    """How scenes are converted to ink, for a tool with its own ink; null where scenes have pen drawings, and for a tool
    that takes paints.
    """
    planner: PlannerConfig

    def __post_init__(self) -> None:
        above_zero(self, "side_m")

    @property
    def side_px(self) -> int:
        """Of the raster that plans are made on."""
        return round(self.side_m * self.planner.pixels_per_m)


@dataclass(frozen=True)
class PaintContext:
    """A medium with its tool and its diagnosed stroke model."""

    medium: Medium
    tool: Tool
    model: StrokeModel

    def __post_init__(self) -> None:
        check_ink(self.medium.ink, self.tool.color_srgb is not None, "The medium", self.tool.name)

    def scene(self, target: Light) -> Scene:
        """A planning problem for a target [S, S, 3], linear light, at the start of a session."""
        side, planner = self.medium.side_m, self.medium.planner
        brush = TorchBrush(self.model, self.tool, planner.path_points)
        return scene_with(brush, self.tool, (side, side), target, style_of(planner))


@dataclass(frozen=True, eq=False)
class Drawn:
    """A plan and its prediction."""

    strokes: Strokes
    sheet: Light
    """The predicted sheet after the strokes; linear light [S, S, 3]."""
    palette_srgb: NDArray[np.float64]
    """[K, 3] paints to prepare, or the tool's own ink."""


def load_paint_context(medium: Medium, stroke_model: Path) -> PaintContext:
    """The medium with its tool and the diagnosed stroke model of a folder.

    Raises:
        ConfigError: the medium's `ink` does not fit the tool.
        ContractError: the folder does not hold what it should.
    """
    return PaintContext(medium, load_tool(medium.tool), read_stroke_model(stroke_model))


def plan_goal(paint_context: PaintContext, sheet: Light, goal: Picture, strokes: int) -> Drawn:
    """Plan a goal picture, uint8 [H, W, 3], on a sheet [S, S, 3] (linear light) with at most `strokes` strokes.

    Strokes that increase the error are removed. A goal that equals the sheet needs no stroke.
    """
    if np.array_equal(goal, as_picture(sheet, goal.shape[0])):
        return Drawn(no_strokes(), sheet, np.zeros((0, 3)))
    return _drawn(paint_context, sheet, as_sheet(goal, paint_context.medium.side_px), strokes)


def draw_scene(paint_context: PaintContext, sheet: Light, image: Picture, strokes: int) -> Drawn:
    """Plan a scene's picture, uint8 [H, W, 3], on top of what the sheet shows.

    A tool with its own ink draws ink tones, as in synthesis; a tool with paints draws colours, but not the picture's
    ground, which is its most common colour. What is on the sheet is part of the target; otherwise the planner would try
    to remove it.
    """
    light, medium = as_sheet(image, paint_context.medium.side_px), paint_context.medium
    if medium.ink is not None:
        light = ink_tones(light.astype(np.float64), medium.planner.pixels_per_m, medium.ink).astype(np.float32)
    light = on_sheet(light, sheet) if paint_context.tool.color_srgb is None else np.minimum(light, sheet)
    return _drawn(paint_context, sheet, light, strokes)


def on_sheet(light: Light, sheet: Light) -> Light:
    """What a picture shows on its ground, its most common colour, on a sheet instead; linear light [S, S, 3] all."""
    ground = np.median(light.reshape(-1, 3), axis=0)
    painted = np.abs(light - ground).max(axis=2, keepdims=True) > _GROUND_RANGE
    return np.where(painted, light, sheet)


def _drawn(paint_context: PaintContext, sheet: Light, target: Light, strokes: int) -> Drawn:
    scene, config = paint_context.scene(target), paint_context.medium.planner
    planned, palette = plan(sheet, scene, strokes, config, no_log)
    useful = without_useless(planned, sheet, scene, config)
    return Drawn(useful, predicted(useful, sheet, scene), palette)


def predicted(strokes: Strokes, sheet: Light, scene: Scene) -> Light:
    """The predicted sheet [S, S, 3] after strokes; linear light."""
    return np.clip(render_plan(strokes, sheet, scene), 0.0, 1.0)


def as_sheet(picture: Picture, side_px: int) -> Light:
    """A square picture, uint8 [H, W, 3], as linear light [side_px, side_px, 3]: averaged down, or interpolated up."""
    light = srgb_to_linear(to_float(picture))
    if light.shape[:2] != (side_px, side_px):
        smaller = side_px < light.shape[0]
        method = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
        light = np.asarray(cv2.resize(light, (side_px, side_px), interpolation=method), dtype=np.float32)
    return np.clip(light, 0, 1)


def as_picture(sheet: Light, side_px: int) -> Picture:
    """A sheet [S, S, 3] (linear light) as a camera of `side_px` pixels sees it, uint8 [side_px, side_px, 3]."""
    light = sheet
    if light.shape[0] != side_px:
        light = np.asarray(cv2.resize(light, (side_px, side_px), interpolation=cv2.INTER_AREA), dtype=np.float32)
    return to_uint8(linear_to_srgb(np.clip(light, 0, 1)))


def seeded(paint_context: PaintContext, seed: int) -> PaintContext:
    """The same context with another seed of its plans."""
    return replace(
        paint_context, medium=replace(paint_context.medium, planner=replace(paint_context.medium.planner, seed=seed))
    )


def plan_text(
    paint_context: PaintContext,
    sheet: Light,
    caption: str,
    *,
    encoder: Encoder,
    strokes: int,
    iterations: int,
    views: int,
    seed: int,
) -> Drawn:
    """Strokes from random places that minimise the text objective, on a sheet [S, S, 3] in linear light (thesis 4.1,
    6.5.1).

    This is the thesis's baseline without a goal planner. The plan with the lowest objective of all iterations is
    returned.
    """
    config, tool = paint_context.medium.planner, paint_context.tool
    scene = paint_context.scene(sheet)
    current = random_strokes(strokes, tool, scene.canvas_size_m, np.random.default_rng([seed, 0]))
    if tool.color_srgb is not None:
        current = with_color(current, np.tile(np.array(tool.color_srgb, np.float32), (strokes, 1)))
    current.keep_within(tool, scene.canvas_size_m, config.edge_m)
    objective = TorchObjective(TextObjective(encoder, caption, views, seed))
    minimum, best = np.inf, current.pick(slice(None))
    values = descend(
        current, sheet, scene, config, objective=objective, iterations=iterations, free_color=tool.color_srgb is None,
        rate=1.0,
    )  # fmt: skip
    for value in values:
        if value < minimum:
            minimum, best = value, current.pick(slice(None))
    if objective(render_plan(current, sheet, scene))[0] < minimum:
        best = current
    best.inherited = None
    palette = linear_to_srgb(best.color).astype(np.float64)  # a paint for each stroke, where colours are free
    return Drawn(best, predicted(best, sheet, scene), np.unique(palette, axis=0))
