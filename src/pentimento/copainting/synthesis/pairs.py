"""From captioned scenes to pairs of a partial and a full painting: what this robot makes of a scene (thesis 6.4.1).

A scene is painted through the stroke model that a diagnosis extended, on a blank sheet, by the planner that the robot
itself uses; partial paintings are the same plan with strokes left out. No robot moves.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pentimento.contracts.colour import linear_to_srgb, srgb_to_linear, to_uint8
from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.images import decode_png, encode_png
from pentimento.contracts.ranges import above_zero, at_least
from pentimento.copainting.scenes.ink_tones import InkTones, ink_tones
from pentimento.copainting.scenes.phrases import phrase
from pentimento.copainting.synthesis.guided_descent import Guidance, descend_guided
from pentimento.copainting.synthesis.partials import Partial, PartialsConfig, partials
from pentimento.dynamics.strokes.extended import StrokeModel, read_stroke_model
from pentimento.dynamics.strokes.planned import TorchBrush
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.config import PlannerConfig
from pentimento.planning.strokes.planner import plan
from pentimento.planning.strokes.render_plan import render_plan
from pentimento.planning.strokes.scene import Scene, inherit, scene_with
from pentimento.planning.strokes.target import fit_to_canvas
from pentimento.robots.tools import Tool, load_tool
from pentimento.semantics.encoder import Encoder
from pentimento.semantics.objective import SemanticObjective
from pentimento.semantics.saliency import saliency
from pentimento.semantics.scores import clip_score
from pentimento.semantics.style.settings import style_of
from pentimento.semantics.style.torch_objective import TorchObjective

FloatArray = NDArray[np.float64]
Light = NDArray[np.float32]
Image = NDArray[np.uint8]
Row = dict[str, Any]


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
    ink: InkTones | None
    """How scenes are turned into ink, for a tool that brings its own; null for a tool that takes paints."""
    guidance: Guidance | None
    """By what the scene means, after it was planned as a likeness; null for none."""
    planner: PlannerConfig
    """Its seed is that of all paintings, together with each scene's id."""

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
        """Height and width at which plans are made."""
        width, height = (max(round(side * self.planner.pixels_per_m), 1) for side in self.canvas_m)
        return height, width

    @property
    def stored_px(self) -> tuple[int, int]:
        """Height and width of the pictures in the table."""
        return max(round(self.picture_px * self.canvas_m[1] / self.canvas_m[0]), 1), self.picture_px


@dataclass(frozen=True, eq=False)
class Painter:
    """The robot's side of a setting: what is the same for all scenes."""

    name: str
    setting: Setting
    tool: Tool
    model: StrokeModel
    encoder: Encoder
    scorer: str
    """The encoder's digest."""


def load_painter(name: str, setting: Setting, stroke_model: Path, semantics: Path) -> Painter:
    """Read the tool, the diagnosed stroke model and the encoder.

    Raises:
        ConfigError: the setting's ``ink`` does not fit the tool.
        ContractError: a folder does not hold what it should.
    """
    tool = load_tool(setting.tool)
    if (setting.ink is None) != (tool.color_srgb is None):
        brings = "its own ink: say under ink how scenes are turned into it" if setting.ink is None else "none: null it"
        raise ConfigError(f"The setting {name} has ink {setting.ink!r}, but the {tool.name} brings {brings}.")
    encoder = Encoder.load(semantics)
    return Painter(name, setting, tool, read_stroke_model(stroke_model), encoder, encoder.digest)


@dataclass(frozen=True, eq=False)
class PlannedPainting:
    """A plan with the scene that it is for."""

    scene: Scene
    canvas: Light
    """[H, W, 3], linear light: the sheet before it."""
    strokes: Strokes
    """With what they inherit where they stand in the whole plan: left alone, they look as they do in the full one."""

    def picture(self, kept: NDArray[np.bool_], shape: tuple[int, int]) -> Image:
        """The painting with only these strokes, sRGB [H, W, 3] of ``shape``: light averaged over pixels."""
        light = render_plan(self.strokes.pick(kept), self.canvas, self.scene)
        return resized(np.clip(light, 0.0, 1.0), shape)

    def points_m(self) -> NDArray[np.float32]:
        """[S, N, 2] places along the strokes, canvas frame."""
        return self.strokes.paths(self.scene.brush.path_points)[..., 1:3]


def plan_painting(painter: Painter, picture: Image, seed: int, canvas: Image | None = None) -> PlannedPainting:
    """Plan a picture, sRGB [H, W, 3], on a blank sheet, or on a canvas as it is, sRGB [H', W', 3] of its proportions.

    The likeness comes first, then semantic guidance joins the print objective.
    """
    setting = painter.setting
    config = replace(setting.planner, seed=seed)
    target = aim(picture, setting).astype(np.float32)
    brush = TorchBrush(painter.model, painter.tool, config.path_points)
    scene = scene_with(brush, painter.tool, setting.canvas_m, target, style_of(config))
    sheet = _sheet(setting) if canvas is None else fit_to_canvas(canvas, setting.planned_px)
    before = sheet.astype(np.float32)
    strokes, _ = plan(before, scene, setting.strokes, config, _unheard)
    if setting.guidance is not None and len(strokes) > 0:
        seen = SemanticObjective(painter.encoder, torch.from_numpy(target), setting.guidance.views, seed)
        meaning = TorchObjective(seen)
        descend_guided(strokes, before, scene, config, meaning, setting.guidance, _unheard)
    strokes.inherited = inherit(strokes, scene)
    return PlannedPainting(scene, before, strokes)


def aim(picture: Image, setting: Setting) -> FloatArray:
    """What a plan should look like, linear light [H, W, 3] at planning's resolution; for ink, its darkness."""
    fitted = fit_to_canvas(picture, setting.planned_px)
    return fitted if setting.ink is None else ink_tones(fitted, setting.planner.pixels_per_m, setting.ink)


def paint_scene(row: Mapping[str, Any], painter: Painter, config: PartialsConfig) -> list[Row]:
    """All rows of the ``copaintings`` contract for one row of ``scenes``: one for each partial painting.

    Depends on the scene, the painter and the planner's seed only, not on other scenes.
    """
    setting, seed = painter.setting, item_seed(painter.setting.planner.seed, row["scene_id"])
    picture, regions = decode_png(row["image"]["bytes"]), decode_png(row["regions"]["bytes"])
    if regions.shape != picture.shape[:2]:
        raise ContractError(
            f"Scene {row['scene_id']}: its regions are {regions.shape}, its image {picture.shape[:2]}; match them."
        )
    painting = plan_painting(painter, picture, seed)
    captions = sayable(row, painter.tool)
    shown = to_uint8(linear_to_srgb(fit_to_canvas(picture, setting.planned_px)))
    salient = saliency(painter.encoder, as_batch([shown]), [captions[0]])[0].numpy()
    labels = fit_labels(regions, setting.planned_px)
    rng = np.random.default_rng([seed, 1])
    found = partials(painting.points_m(), salient, labels, setting.canvas_m, config, rng)
    everything = np.ones(len(painting.strokes), bool)
    full = painting.picture(everything, setting.stored_px)
    order = rng.permutation(len(captions))
    whole = [captions[order[number % len(order)]] for number in range(len(found))]
    scores = clip_score(painter.encoder, as_batch([full] * len(found)), whole).tolist() if found else []
    said = [missing_thing(row, partial, painter.tool) or caption for partial, caption in zip(found, whole, strict=True)]
    png = encode_png(full)
    return [
        {
            "scene_id": row["scene_id"],
            "setting": painter.name,
            "strategy": partial.strategy,
            "region": partial.region,
            "seed": seed,
            "caption": caption,
            "partial": {"bytes": encode_png(painting.picture(partial.kept, setting.stored_px)), "path": None},
            "full": {"bytes": png, "path": None},
            "plan_id": f"{painter.name}/{row['scene_id']}/{seed}",
            "kept": partial.kept.tolist(),
            "clip_score": score,
            "scorer": painter.scorer,
            "split": row["split"],
        }
        for partial, caption, score in zip(found, said, scores, strict=True)
    ]


def item_seed(seed: int, scene_id: str) -> int:
    """31 bits of a scene's own."""
    return int.from_bytes(hashlib.sha256(f"{seed} {scene_id}".encode()).digest()[:4], "big") >> 1


def sayable(row: Mapping[str, Any], tool: Tool) -> list[str]:
    """The scene's wordings; for a tool with one ink, those that name none of its things' colours, where there are any.

    A drawing in black does not show what is red.
    """
    captions = list(dict.fromkeys(row.get("captions") or [row["caption"]]))
    if tool.color_srgb is None:
        return captions
    colors = set(row.get("colors") or [])
    return [caption for caption in captions if not colors & set(caption.replace(",", " ").split())] or captions


def missing_thing(row: Mapping[str, Any], partial: Partial, tool: Tool) -> str | None:
    """A request for the one thing that a partial painting lacks, of several that the scene names; otherwise None.

    Whoever goes on with a drawing may say the whole, or what comes next. The pair's score remains that of the full
    painting with the scene's caption: it tells whether the robot can paint the scene.
    """
    kinds = row.get("objects") or []
    if partial.region is None or len(kinds) < 2 or partial.region > len(kinds):
        return None
    colors = row.get("colors") or [None] * len(kinds)
    color = None if tool.color_srgb is not None else colors[partial.region - 1]
    return phrase(kinds[partial.region - 1], color)


def fit_labels(labels: NDArray[np.uint8], shape: tuple[int, int]) -> NDArray[np.uint8]:
    """What ``fit_to_canvas`` does to a picture, done to its label mask [H, W]."""
    height, width = shape
    scale = max(height / labels.shape[0], width / labels.shape[1])
    crop_h, crop_w = round(height / scale), round(width / scale)
    top, left = (labels.shape[0] - crop_h) // 2, (labels.shape[1] - crop_w) // 2
    part = np.ascontiguousarray(labels[top : top + crop_h, left : left + crop_w])
    return np.asarray(cv2.resize(part, (width, height), interpolation=cv2.INTER_NEAREST), dtype=np.uint8)


def resized(light: NDArray[np.floating], shape: tuple[int, int]) -> Image:
    """Linear light [H, W, 3] at another size, as sRGB: averaged where it shrinks."""
    if light.shape[:2] != shape:
        smaller = shape[0] <= light.shape[0]
        method = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
        light = np.asarray(cv2.resize(light, shape[::-1], interpolation=method))
    return to_uint8(linear_to_srgb(np.clip(light.astype(np.float64), 0.0, 1.0)))


def as_batch(pictures: Sequence[Image]) -> Tensor:
    """SRGB pictures [H, W, 3] as the encoder takes them, [B, 3, H, W] in [0, 1]."""
    return torch.from_numpy(np.stack(pictures)).movedim(-1, 1).float() / 255


def _sheet(setting: Setting) -> FloatArray:
    return np.full((*setting.planned_px, 3), srgb_to_linear(np.array(setting.paper, dtype=np.float64)))


def _unheard(_name: str, _value: float, _step: int) -> None:
    """Curves of single paintings are not kept."""
