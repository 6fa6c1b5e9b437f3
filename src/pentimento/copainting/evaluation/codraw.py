"""Drawing in turns: a person begins, the robot looks, plans a goal for what was asked and adds to it (Figure 6.1)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.calibration.observe import calibrate_camera
from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import decode_png
from pentimento.contracts.markers import markers_around
from pentimento.contracts.ranges import at_least
from pentimento.control.painter import as_linear, observe, paint
from pentimento.copainting.evaluation.cases import plain_caption
from pentimento.copainting.evaluation.goal_plans import PaintContext, draw_scene, laid_out, plan_goal, seen
from pentimento.copainting.scenes.edits import without
from pentimento.copainting.scenes.phrases import listed, phrase
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.config import PlannerConfig
from pentimento.robots.driver import Robot

Picture = NDArray[np.uint8]


@dataclass(frozen=True)
class Codrawing:
    """How person and robot take turns."""

    stories: int
    person: int
    """Strokes that the person draws in a turn, at most."""
    robot: int
    """Strokes that the robot adds in a turn, at most."""
    tremor_m: float
    """Standard deviation of the person's strokes from where they were meant, along each axis."""
    batch: int
    """The robot's strokes between two looks."""

    def __post_init__(self) -> None:
        at_least(self, 1, "stories", "person", "robot", "batch")
        at_least(self, 0, "tremor_m")


@dataclass(frozen=True, eq=False)
class Story:
    """What a person has in mind: in each turn another thing of a scene, and other words."""

    scene_id: str
    prompts: tuple[str, ...]
    images: tuple[Picture, ...]
    """What the person draws in each turn, uint8 [H, W, 3]: the scene with that thing only."""


@dataclass(frozen=True, eq=False)
class Turn:
    """One turn of both; pictures are uint8 sRGB, photographs [S, S, 3], goals [H, W, 3]."""

    prompt: str
    before: Picture
    begun: Picture
    """After the person's strokes."""
    goal: Picture
    predicted: Picture
    after: Picture
    """After the robot's strokes."""
    strokes: tuple[int, int]
    """The person's and the robot's."""


def stories(scenes: pa.Table, count: int, turns: int = 3) -> list[Story]:
    """The first `count` scenes of a checked table that have `turns` things, as stories.

    The words name one thing more in each turn; where the table does not tell what the things are, they are the caption.

    Raises:
        ContractError: no scene has so many things.
    """
    found = []
    for index, row in enumerate(scenes.to_pylist()):
        image, regions = decode_png(row["image"]["bytes"]), decode_png(row["regions"]["bytes"])
        labels = np.unique(regions[regions > 0])[:turns]
        if len(labels) < turns:
            continue
        everything = np.unique(regions[regions > 0])
        images = tuple(without(image, regions, everything[everything != label]) for label in labels)
        kinds = [str(kind) for kind in (row.get("objects") or ())][:turns]
        full = plain_caption(row)
        told = (
            [listed([phrase(kind) for kind in kinds[: number + 1]]) for number in range(turns - 1)]
            if len(kinds) == turns
            else []
        )
        prompts = (*told, full) if told else (full,) * turns
        found.append(Story(str(row.get("scene_id") or index), prompts, images))
        if len(found) == count:
            break
    if not found:
        raise ContractError(f"None of {scenes.num_rows} held-out scenes shows {turns} things; draw more scenes.")
    return found


def codraw(
    robot: Robot,
    paint_context: PaintContext,
    story: Story,
    goal_for: Callable[[Picture, str], Picture],
    config: Codrawing,
    seed: int,
) -> list[Turn]:
    """Play a story on the robot's sheet.

    The person's hand is the robot's arm with a tremor, so that person and robot share pen and paper. `goal_for` gives
    the goal for a photograph, uint8 [H, W, 3] of the story's pictures' size, and a prompt.
    """
    generator = np.random.default_rng([seed, 0])
    medium, turns = paint_context.medium, []
    side = story.images[0].shape[0]
    photo = _look(robot, medium.planner.pixels_per_m)
    for prompt, image in zip(story.prompts, story.images, strict=True):
        meant = draw_scene(paint_context, as_linear(photo), image, config.person)
        drawn = _trembling(meant.strokes, paint_context, medium.planner, config.tremor_m, generator)
        begun = (
            _execute(robot, paint_context, drawn, meant.palette_srgb, image, config.batch, False)
            if len(drawn)
            else photo
        )
        goal = goal_for(seen(as_linear(begun), side), prompt)
        planned = plan_goal(paint_context, as_linear(begun), goal, config.robot)
        predicted = seen(planned.sheet, begun.shape[0])
        after = begun
        if len(planned.strokes):
            after = _execute(robot, paint_context, planned.strokes, planned.palette_srgb, goal, config.batch, True)
        turns.append(Turn(prompt, photo, begun, goal, predicted, after, (len(drawn), len(planned.strokes))))
        photo = after
    return turns


def _look(robot: Robot, pixels_per_m: float) -> Picture:
    return observe(robot, calibrate_camera(robot.photo(), markers_around(robot.canvas_size_m)), pixels_per_m)


def _execute(
    robot: Robot,
    paint_context: PaintContext,
    strokes: Strokes,
    palette_srgb: NDArray[np.float64],
    aim: Picture,
    batch: int,
    replan: bool,
) -> Picture:
    """Make strokes, replanned for the picture `aim` after each batch or not; a photograph, uint8 [S, S, 3]."""
    scene = paint_context.scene(laid_out(aim, paint_context.medium.side_px))
    made = paint(
        robot,
        scene,
        strokes,
        palette_srgb=palette_srgb,
        batch=batch,
        replan=replan,
        config=paint_context.medium.planner,
        log=_unheard,
    )
    return made.photos[-1]


def _trembling(
    strokes: Strokes,
    paint_context: PaintContext,
    config: PlannerConfig,
    tremor_m: float,
    generator: np.random.Generator,
) -> Strokes:
    """Strokes as a hand that trembles makes them, within what tool and sheet allow."""
    moved = strokes.pick(slice(None))
    moved.inherited = None
    moved.middle_m += generator.normal(0, tremor_m, moved.middle_m.shape).astype(np.float32)
    moved.keep_within(paint_context.tool, (paint_context.medium.side_m, paint_context.medium.side_m), config.edge_m)
    return moved


def _unheard(_name: str, _value: float, _step: int) -> None:
    """Curves of single turns are not kept."""
