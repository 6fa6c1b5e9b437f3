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
from pentimento.contracts.ranges import above_zero, at_least
from pentimento.contracts.scenes import labels_of, listed, phrase, read_scene
from pentimento.control.painter import as_linear, observe, paint
from pentimento.copainting.drawings.sources import nouns_of
from pentimento.copainting.evaluation.cases import Case, plain_caption
from pentimento.copainting.evaluation.goal_plans import Drawn, PaintContext, as_picture, as_sheet, draw_scene, plan_goal
from pentimento.copainting.evaluation.scoring import (
    FloatArray,
    Judges,
    changed_share,
    objects_found,
    seen_there,
    surviving_ink,
)
from pentimento.copainting.scenes.collage import without
from pentimento.planning.strokes.bezier import Strokes, no_strokes
from pentimento.planning.strokes.config import no_log
from pentimento.robots.driver import Robot
from pentimento.semantics.encoder import Encoder, as_images
from pentimento.semantics.scores import clip_score, object_scores, recognised

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
    wishes: int
    """Turns in which a person asks for another named thing."""
    largest: float
    """Maximum side of what a turn adds to a sheet of named things, in sides of the sheet: the others need room."""

    def __post_init__(self) -> None:
        at_least(self, 1, "stories", "person_strokes", "robot_strokes", "replan_every", "wishes")
        above_zero(self, "largest")
        at_least(self, 0, "tremor_m")


@dataclass(frozen=True, eq=False)
class Story:
    """What a person wants to draw: one more thing of a scene in each turn, with a prompt."""

    scene_id: str
    prompts: tuple[str, ...]
    images: tuple[Picture | None, ...]
    """What the person draws in each turn, uint8 [H, W, 3]: the scene with that thing only; None for nothing."""
    side_px: int
    """Of the goals."""
    first: str | None
    """The thing that the first prompt asks for, where it is one of the judge's kinds."""


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


def stories(scenes: pa.Table, count: int, turns: int) -> list[Story]:
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
        found.append(Story(name, (*shorter, caption), images, image.shape[0], None))
        if len(found) == count:
            break
    if not found:
        raise ContractError(f"None of {scenes.num_rows} held-out scenes shows {turns} things; draw more scenes.")
    return found


def wishes(count: int, *, turns: int, side_px: int, seed: int) -> list[Story]:
    """Stories of a person who asks for another named thing in each turn, and draws nothing."""
    nouns = nouns_of("openmoji")
    orders = (np.random.default_rng([seed, index]).permutation(len(nouns))[:turns] for index in range(count))
    asked = [[nouns[int(pick)] for pick in order] for order in orders]
    return [
        Story(f"wishes_{index:03d}", tuple(map(phrase, names)), (None,) * turns, side_px, names[0])
        for index, names in enumerate(asked)
    ]


def one_turn_each(cases: Sequence[Case]) -> list[Story]:
    """A story of one turn for each case: a person draws the other scene, if there is one, then makes the request."""
    return [
        Story(
            case.scene_id, (case.caption,), (case.other_image if case.other_objects else None,), case.image.shape[0],
            None,
        )
        for case in cases
    ]  # fmt: skip


def executed_found(played: Sequence[Sequence[Turn]], cases: Sequence[Case], judges: Judges) -> FloatArray:
    """The scores [B] of `objects_found` for photographs before and after the robot's strokes, a turn for each case."""
    side = cases[0].image.shape[0]
    before, after = (_shrunk([getattr(turn, name) for (turn,) in played], side) for name in ("started", "after"))
    return objects_found(judges, before, after, cases)


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
    side = story.side_px
    photo = _look(robot, medium.planner.pixels_per_m)
    for prompt, image in zip(story.prompts, story.images, strict=True):
        drawn, started = no_strokes(), photo
        if image is not None:
            intended = draw_scene(paint_context, as_linear(photo), image, config.person_strokes)
            drawn = _trembling(intended.strokes, paint_context, config.tremor_m, generator)
            by_person = replace(intended, strokes=drawn)
            if len(drawn):
                started = _execute(
                    robot, paint_context, by_person, image, replan_every=config.replan_every, replan=False
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


def turn_scores(
    played: Sequence[Sequence[Turn]], told: Sequence[Story], judge: Encoder, kinds: Sequence[str]
) -> list[dict[str, float | None]]:
    """For each turn, means over stories: the judge's score before and after the robot, what it changed and kept, the
    covered share of the sheet, and whether the judge finds the first turn's thing among `kinds` where it was drawn.
    """
    scores = []
    for number in range(len(played[0])):
        blank, after = _sheets(played, number)
        scores.append(
            _of_turn([story[number] for story in played], judge)
            | {
                "covered": _mean(changed_share(blank, after)),
                "first_found": _first_found(played, number, told, judge, kinds),
            }
        )
    return scores


def _sheets(played: Sequence[Sequence[Turn]], number: int) -> tuple[Picture, Picture]:
    """The blank sheets and those after a turn."""
    side = played[0][0].goal.shape[0]
    blank, after = [story[0].before for story in played], [story[number].after for story in played]
    return _shrunk(blank, side), _shrunk(after, side)


def _first_found(
    played: Sequence[Sequence[Turn]], number: int, told: Sequence[Story], judge: Encoder, kinds: Sequence[str]
) -> float | None:
    if any(story.first is None for story in told):
        return None
    blank, first = _sheets(played, 0)
    views = [seen_there(*sheets) for sheets in zip(blank, first, _sheets(played, number)[1], strict=True)]
    hits = recognised(object_scores(judge, as_images(views), kinds), kinds, [[str(story.first)] for story in told])
    return float(np.mean([hit for of_one in hits for hit in of_one]))


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
