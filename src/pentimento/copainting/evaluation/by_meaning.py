"""Paintings by any sum of objectives, each beside the paintings that its terms give alone (thesis 4.5.3).

All of them have equal strokes, iterations and start. The judge, an encoder that guides none of them, compares what the
robot painted in the studio with the picture and the words.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pentimento.bundle.views import random_views
from pentimento.calibration.observe import calibrate_camera
from pentimento.contracts.colour import srgb_to_linear
from pentimento.contracts.images import decode_png
from pentimento.contracts.markers import markers_around
from pentimento.contracts.ranges import at_least
from pentimento.contracts.scenes import phrase
from pentimento.control.guard import GuardedRobot
from pentimento.control.painter import as_linear, observe, paint, predict
from pentimento.control.safety import envelope_for
from pentimento.copainting.drawings.sources import vocabulary
from pentimento.copainting.evaluation.goal_plans import on_sheet
from pentimento.dynamics.strokes.extended import StrokeModel
from pentimento.dynamics.strokes.planned import TorchBrush
from pentimento.planning.strokes.config import PRINT_ALONE, ObjectivesConfig, PlannerConfig, no_log
from pentimento.planning.strokes.planner import plan
from pentimento.planning.strokes.scene import Scene, objective_for, scene_with
from pentimento.planning.strokes.target import fit_to_canvas, fit_to_ink
from pentimento.robots.driver import Robot
from pentimento.robots.tools import Tool, load_tool
from pentimento.robots.virtual import virtual_robot
from pentimento.semantics.encoder import Encoder, as_images
from pentimento.semantics.objective import EncoderMeaning, with_views
from pentimento.semantics.style import style_of

Light = NDArray[np.float32]
Picture = NDArray[np.uint8]

SUM = "sum"
"""The painting by all objectives of a setting."""
_AT_ONCE = 256
"""Pictures of the scenes that are decoded and embedded together: all of them may not fit into memory."""
_JUDGED_VIEWS = 8
"""Views in which the judge, and the objectives of a finished plan, see a picture, beside the plain one."""


@dataclass(frozen=True)
class MeaningSetting:
    """A painting by a sum of objectives."""

    picture: str | None
    """The target: a file, or the name of a photograph that scikit-image ships. Null where words are an objective and no
    target is: the plan then starts from the picture of the scenes that is nearest to the words for the encoder.
    """
    tool: str
    world: str
    """The studio's."""
    canvas_m: tuple[float, float]
    darkest: float
    """For a tool with its own ink: the lightness (0 to 1) of the target's darkest tone."""
    strokes: int
    replan_every: int
    planner: PlannerConfig

    def __post_init__(self) -> None:
        at_least(self, 0, "darkest")
        at_least(self, 1, "strokes", "replan_every")
        if self.darkest >= 1:
            raise ValueError(f"darkest is {self.darkest}; it must be below 1, or the target is all white.")
        objectives = self.planner.objectives
        if (self.picture is None) != (objectives.text is not None and not objectives.has_target):
            raise ValueError(
                f"picture is {self.picture!r}; null needs words, with print_weight and semantic_weight 0, and all "
                "other objectives need a picture."
            )


@dataclass(frozen=True, eq=False)
class Networks:
    """The encoders."""

    guide: Encoder
    judge: Encoder
    views: int
    """Of the guide, beside the plain picture."""


@dataclass(frozen=True, eq=False)
class PaintedByMeaning:
    """A plan, and its execution in the studio."""

    planned: Picture
    """The finished painting as predicted, sRGB [H, W, 3]."""
    painted: Picture
    """As photographed, with replanning."""
    objectives: dict[str, float]
    """Of the plan, by term, not weighted."""


def alternatives(objectives: ObjectivesConfig) -> dict[str, ObjectivesConfig]:
    """The sum, each of its terms alone, and always the print objective, of where the others start."""
    semantic = ObjectivesConfig(print_weight=0.0, semantic_weight=1.0, text=None, style=None)
    found = {"print": PRINT_ALONE}
    if objectives.semantic_weight > 0:
        found["semantic"] = semantic
    if objectives.text is not None:
        found["text"] = replace(semantic, semantic_weight=0.0, text=objectives.text)
    if objectives.style is not None:
        found["style"] = replace(semantic, semantic_weight=0.0, style=objectives.style)
    return {SUM: objectives} | {name: alone for name, alone in found.items() if alone != objectives}


def paint_by_meaning(
    setting: MeaningSetting,
    start: Picture,
    model: StrokeModel,
    networks: Networks,
    *,
    studio_seed: int,
    names: Sequence[str] | None = None,
) -> tuple[Light, dict[str, PaintedByMeaning]]:
    """Plan and paint each of the `alternatives`, or those of these names.

    Args:
        start: sRGB [H, W, 3], the setting's picture, or the one from which words start.
        model: of the setting's tool.

    Returns:
        The target, linear light [H, W, 3], and the painting of each alternative.
    """
    tool, planner = load_tool(setting.tool), setting.planner
    _, blank = _before_a_blank_sheet(setting, tool, studio_seed)
    photograph = fit_to_canvas(start, blank.shape[:2])
    target = (photograph if tool.color_srgb is None else fit_to_ink(photograph, setting.darkest)).astype(np.float32)
    if setting.picture is None:
        target = on_sheet(target, as_linear(blank))
    brush = TorchBrush(model, tool, planner.path_points)
    meaning = EncoderMeaning(networks.guide, networks.views, planner.seed)
    scene = scene_with(brush, tool, setting.canvas_m, target, style_of(planner), meaning)
    return photograph.astype(np.float32), {
        name: _painted(setting, scene, replace(planner, objectives=objectives), networks, studio_seed)
        for name, objectives in alternatives(planner.objectives).items()
        if names is None or name in names
    }


def _painted(
    setting: MeaningSetting, scene: Scene, planner: PlannerConfig, networks: Networks, studio_seed: int
) -> PaintedByMeaning:
    robot, blank = _before_a_blank_sheet(setting, scene.tool, studio_seed)
    strokes, palette = plan(as_linear(blank), scene, setting.strokes, planner, no_log)
    light = srgb_to_linear(np.clip(predict(strokes, blank, scene), 0.0, 1.0))
    painting = paint(
        robot, scene, strokes, palette_srgb=palette, replan_every=setting.replan_every, replan=True, config=planner,
        log=no_log,
    )  # fmt: skip
    seen = replace(scene, meaning=EncoderMeaning(networks.guide, _JUDGED_VIEWS, setting.planner.seed))
    every = replace(setting.planner, objectives=replace(setting.planner.objectives, print_weight=1.0))
    return PaintedByMeaning(
        painting.predicted, painting.photos[-1], objective_for(seen, every).values(light.astype(np.float32))
    )


def _before_a_blank_sheet(setting: MeaningSetting, tool: Tool, studio_seed: int) -> tuple[Robot, Picture]:
    """A robot in the studio, and a photograph of its blank sheet, sRGB [H, W, 3]."""
    robot = GuardedRobot(
        virtual_robot(setting.world, setting.canvas_m, studio_seed), envelope_for(tool, setting.canvas_m)
    )
    robot.change_tool(tool)
    calibration = calibrate_camera(robot.photo(), markers_around(setting.canvas_m))
    return robot, observe(robot, calibration, setting.planner.pixels_per_m)


def nearest_picture(words: str, rows: Sequence[Mapping[str, Any]], guide: Encoder) -> Picture:
    """The picture, sRGB [H, W, 3], of the scenes (rows of the scenes contract) that is nearest to the words."""
    with torch.no_grad():
        wanted = guide.embed_texts([words])[0]
        cosines = torch.cat([
            guide.embed_images(as_images([decode_png(row["image"]["bytes"]) for row in rows[at : at + _AT_ONCE]]))
            @ wanted
            for at in range(0, len(rows), _AT_ONCE)
        ])  # fmt: skip
    return decode_png(rows[int(cosines.argmax())]["image"]["bytes"])


def similarity(judge: Encoder, picture: Picture, other: Picture) -> float:
    """Mean cosine of what the judge sees in the same views of two pictures of one size, sRGB [H, W, 3]."""
    return float((_seen(judge, picture) * _seen(judge, other)).sum(1).mean())


def rank_of_words(judge: Encoder, picture: Picture, words: str) -> int:
    """The rank of the words among the names of all drawn things, by the judge's cosine with a picture; 1 is best."""
    names = [name for name in map(phrase, vocabulary()) if name != words]
    cosines = _seen(judge, picture)[0] @ judge.embed_texts([words, *names]).T
    return 1 + int((cosines[1:] > cosines[0]).sum())


def _seen(judge: Encoder, picture: Picture) -> Tensor:
    """Unit vectors [1 + V, D] of the picture and of its views."""
    views = torch.from_numpy(random_views(_JUDGED_VIEWS, np.random.default_rng(0)))
    with torch.no_grad():
        return judge.embed_images(with_views(as_images([picture]), views))
