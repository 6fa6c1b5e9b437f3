"""Drawing in turns: a person starts, the robot photographs the sheet, plans a goal and adds strokes (Figure 6.1)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.calibration.observe import calibrate_camera
from pentimento.contracts.errors import ContractError
from pentimento.contracts.markers import markers_around
from pentimento.contracts.ranges import at_least
from pentimento.contracts.scenes import labels_of, listed, phrase, read_scene
from pentimento.control.painter import as_linear, observe, paint
from pentimento.copainting.evaluation.cases import plain_caption
from pentimento.copainting.evaluation.goal_plans import Drawn, PaintContext, as_picture, as_sheet, draw_scene, plan_goal
from pentimento.copainting.evaluation.scoring import changed_share, surviving_ink
from pentimento.copainting.scenes.collage import without
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.config import no_log
from pentimento.robots.driver import Robot
from pentimento.semantics.encoder import Encoder, as_images
from pentimento.semantics.scores import clip_score

Picture = NDArray[np.uint8]


@dataclass(frozen=True)
class Codrawing:
    """How person and robot take turns."""

    stories: int
    person_strokes: int
    """Maximum in one turn."""
    robot_strokes: int
    """Maximum in one turn."""
    tremor_m: float
    """Standard deviation of the offset of the person's strokes, along each axis."""
    replan_every: int
    """Strokes of the robot between two photographs."""

    def __post_init__(self) -> None:
        at_least(self, 1, "stories", "person_strokes", "robot_strokes", "replan_every")
        at_least(self, 0, "tremor_m")


@dataclass(frozen=True, eq=False)
class Story:
    """What a person wants to draw: one more thing of a scene in each turn, with a prompt."""

    scene_id: str
    prompts: tuple[str, ...]
    images: tuple[Picture, ...]
    """What the person draws in each turn, uint8 [H, W, 3]: the scene with that thing only."""


@dataclass(frozen=True, eq=False)
class Turn:
    """One turn of person and robot; pictures are uint8 sRGB, photographs [S, S, 3], goals [H, W, 3]."""

    prompt: str
    before: Picture
    started: Picture
    """After the person's strokes."""
    goal: Picture
    predicted: Picture
    after: Picture
    """After the robot's strokes."""
    strokes: tuple[int, int]
    """Numbers of the person's and of the robot's strokes."""


def stories(scenes: pa.Table, count: int, turns: int = 3) -> list[Story]:
    """The first `count` scenes of a checked table that have at least `turns` things, as stories.

    The prompt of each turn names one thing more; in a table without objects it is the caption.

    Raises:
        ContractError: no scene has so many things.
    """
    found = []
    for index, row in enumerate(scenes.to_pylist()):
        name = str(row.get("scene_id") or index)
        image, regions = read_scene(row, f"Scene {name}")
        labels = labels_of(regions)
        if len(labels) < turns:
            continue
        images = tuple(without(image, regions, labels[labels != label]) for label in labels[:turns])
        kinds = [str(kind) for kind in (row.get("objects") or ())][:turns]
        caption = plain_caption(row)
        shorter = [caption] * (turns - 1)
        if len(kinds) == turns:
            shorter = [listed([phrase(kind) for kind in kinds[: number + 1]]) for number in range(turns - 1)]
        found.append(Story(name, (*shorter, caption), images))
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
    *,
    config: Codrawing,
    seed: int,
) -> list[Turn]:
    """Play a story on the robot's sheet.

    The person is simulated by the robot's arm with a tremor, so both share pen and paper. `goal_for` returns the goal
    for a photograph, uint8 [H, W, 3] in the size of the story's pictures, and a prompt.
    """
    generator = np.random.default_rng([seed, 0])
    medium, turns = paint_context.medium, []
    side = story.images[0].shape[0]
    photo = _look(robot, medium.planner.pixels_per_m)
    for prompt, image in zip(story.prompts, story.images, strict=True):
        intended = draw_scene(paint_context, as_linear(photo), image, config.person_strokes)
        drawn = _trembling(intended.strokes, paint_context, config.tremor_m, generator)
        started = (
            _execute(
                robot,
                paint_context,
                replace(intended, strokes=drawn),
                image,
                replan_every=config.replan_every,
                replan=False,
            )
            if len(drawn)
            else photo
        )
        goal = goal_for(as_picture(as_linear(started), side), prompt)
        planned = plan_goal(paint_context, as_linear(started), goal, config.robot_strokes)
        predicted = as_picture(planned.sheet, started.shape[0])
        after = started
        if len(planned.strokes):
            after = _execute(robot, paint_context, planned, goal, replan_every=config.replan_every, replan=True)
        turns.append(Turn(prompt, photo, started, goal, predicted, after, (len(drawn), len(planned.strokes))))
        photo = after
    return turns


def _look(robot: Robot, pixels_per_m: float) -> Picture:
    return observe(robot, calibrate_camera(robot.photo(), markers_around(robot.canvas_size_m)), pixels_per_m)


def _execute(
    robot: Robot, paint_context: PaintContext, drawn: Drawn, target: Picture, *, replan_every: int, replan: bool
) -> Picture:
    """Execute a plan, optionally replanned for the target after each batch; the final photograph, uint8 [S, S, 3]."""
    scene = paint_context.scene(as_sheet(target, paint_context.medium.side_px))
    config = paint_context.medium.planner
    painting = paint(
        robot, scene, drawn.strokes, palette_srgb=drawn.palette_srgb, replan_every=replan_every, replan=replan,
        config=config,
        log=no_log,
    )  # fmt: skip
    return painting.photos[-1]


def _trembling(
    strokes: Strokes, paint_context: PaintContext, tremor_m: float, generator: np.random.Generator
) -> Strokes:
    """Strokes with a random offset each, within the limits of tool and sheet."""
    medium = paint_context.medium
    moved = strokes.pick(slice(None))
    moved.inherited = None
    moved.middle_m += generator.normal(0, tremor_m, moved.middle_m.shape).astype(np.float32)
    moved.keep_within(paint_context.tool, (medium.side_m, medium.side_m), medium.planner.edge_m)
    return moved


def turn_scores(played: Sequence[Sequence[Turn]], judge: Encoder) -> list[dict[str, float | None]]:
    """For each turn, means over stories: the judge's score before and after the robot, and what it changed and kept."""
    return [_of_turn([story[number] for story in played], judge) for number in range(len(played[0]))]


def film_strip(story: Sequence[Turn]) -> dict[str, list[Picture]]:
    """Columns for `sheets.side_by_side`: the person's drawing, the goal, the plan and the result of each turn."""
    return {
        "person draws": [turn.started for turn in story],
        "goal": [turn.goal for turn in story],
        "plan": [turn.predicted for turn in story],
        "robot adds": [turn.after for turn in story],
    }


def _of_turn(turns: Sequence[Turn], judge: Encoder) -> dict[str, float | None]:
    side = turns[0].goal.shape[0]
    before, after = (_shrunk([getattr(turn, name) for turn in turns], side) for name in ("started", "after"))
    goals, prompts = np.stack([turn.goal for turn in turns]), [turn.prompt for turn in turns]
    return {
        "judge_score_no_change": _mean(clip_score(judge, as_images(before), prompts)),
        "judge_score": _mean(clip_score(judge, as_images(after), prompts)),
        "goal_keeps": _mean(surviving_ink(before, goals)),
        "drawing_keeps": _mean(surviving_ink(before, after)),
        "changed": _mean(changed_share(before, after)),
        "strokes": _mean([turn.strokes[1] for turn in turns]),
    }


def _mean(values: Any) -> float | None:
    """Of the finite values; None if there is none."""
    known = np.asarray(values, dtype=np.float64)
    known = known[np.isfinite(known)]
    return float(known.mean()) if len(known) else None


def _shrunk(photos: Sequence[Picture], side: int) -> Picture:
    return np.stack([as_picture(as_linear(photo), side) for photo in photos])
