"""A painting setting of the robot, and the plans it makes of pictures with its diagnosed stroke model (thesis
6.4.1)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb, srgb_to_linear, to_uint8
from pentimento.contracts.ranges import above_zero, at_least
from pentimento.copainting.scenes.ink import InkTones, check_ink, ink_tones
from pentimento.dynamics.strokes.extended import StrokeModel, read_stroke_model
from pentimento.dynamics.strokes.planned import TorchBrush
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.config import PlannerConfig, no_log
from pentimento.planning.strokes.descent import descend
from pentimento.planning.strokes.planner import plan
from pentimento.planning.strokes.render_plan import render_plan
from pentimento.planning.strokes.scene import Scene, inherit, objective_for, scene_with
from pentimento.planning.strokes.target import fit_to_canvas
from pentimento.robots.tools import Tool, load_tool
from pentimento.semantics.encoder import Encoder
from pentimento.semantics.objective import EncoderMeaning
from pentimento.semantics.style import style_of

FloatArray = NDArray[np.float64]
Light = NDArray[np.float32]
Image = NDArray[np.uint8]


@dataclass(frozen=True)
class Guidance:
    """Semantic guidance of a plan, after the print objective alone."""

    weight: float
    """Of the semantic objective, added to the planner's own."""
    iterations: int
    rate: float
    """Initial fraction of the planner's learning rates; it decays to 0."""
    views: int
    """Random views of the picture at each iteration, beside the plain one."""

    def __post_init__(self) -> None:
        above_zero(self, "weight", "rate")
        at_least(self, 1, "iterations")
        at_least(self, 0, "views")


@dataclass(frozen=True)
class Setting:
    """One painting setting of the robot (thesis 6.5.2)."""

    tool: str
    canvas_m: tuple[float, float]
    """Width and height of the sheet."""
    picture_px: int
    """Width of the pictures in the table."""
    paper: float
    """The sheet's grey, sRGB from 0 to 1."""
    strokes: int
    words: str
    """What a request to the goal planner says of the medium."""
    ink: InkTones | None
    """How scenes are converted to ink, for a tool with its own ink; null where scenes have pen drawings, and for a tool
    that takes paints.
    """
    guidance: Guidance | None
    """Null for no semantic guidance."""
    planner: PlannerConfig
    """Its seed is combined with the id of each scene."""

    def __post_init__(self) -> None:
        at_least(self, 1, "strokes")
        at_least(self, 8, "picture_px")
        at_least(self, 0, "paper")
        if self.paper > 1:
            raise ValueError(f"paper is {self.paper}; it must be 1 or less.")
        if min(self.canvas_m) <= 0:
            raise ValueError(f"canvas_m is {list(self.canvas_m)}; both sides must be above 0.")
        above_zero(self.planner, "pixels_per_m")

    @property
    def planned_px(self) -> tuple[int, int]:
        """Height and width of the raster that plans are made on."""
        width, height = (max(round(side * self.planner.pixels_per_m), 1) for side in self.canvas_m)
        return height, width

    @property
    def stored_px(self) -> tuple[int, int]:
        """Height and width of the pictures in the table."""
        return max(round(self.picture_px * self.canvas_m[1] / self.canvas_m[0]), 1), self.picture_px


@dataclass(frozen=True, eq=False)
class Painter:
    """What all scenes of a setting share."""

    name: str
    setting: Setting
    tool: Tool
    model: StrokeModel
    encoder: Encoder
    scorer: str
    """Digest of the encoder."""


def load_painter(name: str, setting: Setting, stroke_model: Path, semantics: Path) -> Painter:
    """Read the tool, the diagnosed stroke model and the encoder.

    Raises:
        ConfigError: the setting's `ink` does not fit the tool.
        ContractError: a folder does not hold what it should.
    """
    tool = load_tool(setting.tool)
    check_ink(setting.ink, tool.color_srgb is not None, f"The setting {name}", tool.name)
    encoder = Encoder.load(semantics)
    return Painter(name, setting, tool, read_stroke_model(stroke_model), encoder, encoder.digest)


@dataclass(frozen=True, eq=False)
class PlannedPainting:
    """A plan and its scene."""

    scene: Scene
    canvas: Light
    """[H, W, 3], linear light: the sheet before the plan."""
    strokes: Strokes
    """With the state that each inherits from the strokes before it in the whole plan. A subset therefore looks as it
    does in the full painting.
    """

    def picture(self, kept: NDArray[np.bool_], shape: tuple[int, int]) -> Image:
        """The painting with these strokes only, sRGB [H, W, 3] of `shape`; light is averaged over pixels."""
        light = render_plan(self.strokes.pick(kept), self.canvas, self.scene)
        return resized(np.clip(light, 0.0, 1.0), shape)

    def points_m(self) -> NDArray[np.float32]:
        """[S, N, 2] points along the strokes, canvas frame."""
        return self.strokes.paths(self.scene.brush.path_points)[..., 1:3]


def plan_painting(painter: Painter, picture: Image, seed: int, canvas: Image | None = None) -> PlannedPainting:
    """Plan a picture, sRGB [H, W, 3], on a blank sheet or on a canvas, sRGB [H', W', 3] of the sheet's proportions.

    The print objective is optimised first, then the print and the semantic objective together.
    """
    setting = painter.setting
    config = replace(setting.planner, seed=seed)
    target = plan_target(picture, setting).astype(np.float32)
    brush = TorchBrush(painter.model, painter.tool, config.path_points)
    views = 0 if setting.guidance is None else setting.guidance.views
    meaning = EncoderMeaning(painter.encoder, views, seed)
    scene = scene_with(brush, painter.tool, setting.canvas_m, target, style_of(config), meaning)
    sheet = _sheet(setting) if canvas is None else fit_to_canvas(canvas, setting.planned_px)
    before = sheet.astype(np.float32)
    strokes, _ = plan(before, scene, setting.strokes, config, no_log)
    if setting.guidance is not None and len(strokes) > 0:
        descend_guided(strokes, before, scene, config=config, guidance=setting.guidance)
    strokes.inherited = inherit(strokes, scene)
    return PlannedPainting(scene, before, strokes)


def plan_target(picture: Image, setting: Setting) -> FloatArray:
    """The target of a plan, linear light [H, W, 3] at the planner's resolution; for ink, its darkness."""
    fitted = fit_to_canvas(picture, setting.planned_px)
    return fitted if setting.ink is None else ink_tones(fitted, setting.planner.pixels_per_m, setting.ink)


def resized(light: NDArray[np.floating], shape: tuple[int, int]) -> Image:
    """Linear light [H, W, 3] at another size, as sRGB; pixels are averaged if it shrinks."""
    if light.shape[:2] != shape:
        smaller = shape[0] <= light.shape[0]
        method = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
        light = np.asarray(cv2.resize(light, shape[::-1], interpolation=method))
    return to_uint8(linear_to_srgb(np.clip(light.astype(np.float64), 0.0, 1.0)))


def _sheet(setting: Setting) -> FloatArray:
    return np.full((*setting.planned_px, 3), srgb_to_linear(np.array(setting.paper, dtype=np.float64)))


def descend_guided(strokes: Strokes, canvas: Light, scene: Scene, *, config: PlannerConfig, guidance: Guidance) -> None:
    """Descend, in place, on the planner's objective plus the weighted semantic objective; colours stay as they are.

    The semantic objective draws other views at each iteration, so its values do not compare. Strokes therefore end
    after the last iteration, not at the lowest value (thesis 4.5).
    """
    guided = replace(config, objectives=replace(config.objectives, semantic_weight=guidance.weight))
    objective = objective_for(scene, guided)
    values = descend(
        strokes, canvas, scene, config, objective=objective, iterations=guidance.iterations, free_color=False,
        rate=guidance.rate,
    )  # fmt: skip
    for _ in values:
        pass
