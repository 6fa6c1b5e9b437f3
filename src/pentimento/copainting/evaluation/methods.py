"""The compared methods of Table 6.1: each gives a goal for a prompt on a started canvas, which is planned in strokes.

The Low-Level Action Planner predicts the drawing for each goal. Scores are of the predicted drawing; gaps are between
the goal and that drawing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pentimento.bundle.vocabulary import Vocabulary
from pentimento.contracts.ranges import at_least
from pentimento.control.goal import keep_canvas
from pentimento.control.layout import drawn_in_windows, wishes_for
from pentimento.control.request import MAX_THINGS, understand
from pentimento.copainting.evaluation.cases import Case
from pentimento.copainting.evaluation.goal_plans import (
    Drawn,
    PaintContext,
    as_picture,
    as_sheet,
    draw_scene,
    plan_goal,
    plan_text,
    seeded,
)
from pentimento.copainting.goal.planner import GoalPlanner, SeededSampling, complete, load_goal_planner
from pentimento.copainting.goal.vae import round_trip
from pentimento.copainting.jobs import Submit, gather
from pentimento.semantics.encoder import Encoder

Pictures = NDArray[np.uint8]
Light = NDArray[np.float32]

NO_CHANGE: Final = "no_change"
COPY: Final = "copy_input"
IGNORE: Final = "ignore_input"
TEXT_ONLY: Final = "text_only"
BASE: Final = "base"
FINE_TUNED: Final = "fine_tuned"
ORACLE: Final = "oracle"
ON_CANVAS: Final = (NO_CHANGE, COPY, IGNORE, TEXT_ONLY, BASE, FINE_TUNED, ORACLE)
"""Methods on a started canvas: no stroke; the canvas as the goal; the base planner given blank paper instead of the
canvas; strokes by the text objective without a goal planner; the base planner; the fine-tuned planner; and the true
full drawing as the goal."""
ON_PAPER: Final = (NO_CHANGE, BASE, FINE_TUNED, ORACLE)
"""Methods on blank paper."""


@dataclass(frozen=True)
class TextOnly:
    """The method that plans by the text objective alone."""

    iterations: int
    views: int
    """Random views of the picture at each iteration, beside the plain one."""

    def __post_init__(self) -> None:
        at_least(self, 0, "iterations", "views")


@dataclass(frozen=True)
class Strokes:
    """Maximum numbers of strokes."""

    begun: int
    """In the drawing of the other prompt that starts the canvas (thesis 6.6.1: 35)."""
    added: int
    """By the robot."""

    def __post_init__(self) -> None:
        at_least(self, 1, "begun", "added")


@dataclass(frozen=True, eq=False)
class Outcomes:
    """What each method drew for each case; pictures are uint8 [B, H, W, 3]."""

    canvases: Pictures
    goals: dict[str, Pictures]
    """Of the methods that have goals."""
    drawings: dict[str, Pictures]
    """The predicted sheets."""
    strokes: dict[str, list[int]]
    """Number of strokes of each plan."""


@dataclass(frozen=True)
class Planners:
    """Folders of the goal planners."""

    base: Path
    fine_tuned: Path


@dataclass(frozen=True)
class Task:
    """What all cases share."""

    paint_context: PaintContext
    """Of the robot."""
    begun_with: PaintContext
    """Of the drawings that start the canvases: the robot's, or another medium on an equal sheet (thesis 6.6.4)."""
    blank: Pictures
    """Blank paper, uint8 [H, W, 3], in the size of the goal planners' pictures."""
    planners: Planners
    encoder: Path
    """Folder of the encoder that guides the method without a goal planner."""
    vocabulary: Vocabulary | None
    """What the goal planners were taught; None if they know all words."""
    strokes: Strokes
    sampling: SeededSampling
    text_only: TextOnly
    seed: int
    """Of all plans. Each plan depends on (seed, case) only, not on the number of workers."""


def run_on_canvas(cases: Sequence[Case], task: Task, methods: Sequence[str], submit: Submit) -> Outcomes:
    """Run methods of `ON_CANVAS`, by submitted jobs, on canvases that show drawings of other prompts."""
    side, numbers = task.blank.shape[0], range(len(cases))
    captions = [case.caption for case in cases]
    started = gather([submit(_start, task, case, ORACLE in methods, i) for i, case in enumerate(cases)])
    sheets = [sheet for sheet, _ in started]
    canvases = np.stack([as_picture(sheet, side) for sheet in sheets])
    papers = np.stack([task.blank] * len(cases))
    futures = {
        name: submit(_complete, folder, inputs, captions, task)
        for name, folder, inputs in (
            (BASE, task.planners.base, canvases),
            (FINE_TUNED, task.planners.fine_tuned, canvases),
            (IGNORE, task.planners.base, papers),
        )
        if name in methods
    }
    by_text = [
        submit(_from_text, task, sheet, caption, i)
        for i, sheet, caption in zip(numbers, sheets, captions, strict=True)
        if TEXT_ONLY in methods
    ]
    goals = {name: future.result() for name, future in futures.items()}
    if COPY in methods:
        goals[COPY] = canvases
    if ORACLE in methods:
        goals[ORACLE] = np.stack([as_picture(full, side) for _, full in started])
    plans = {
        name: [submit(_plan, task, sheet, goal, i) for i, sheet, goal in zip(numbers, sheets, pictures, strict=True)]
        for name, pictures in goals.items()
    }
    drawn = {name: gather(of_one) for name, of_one in plans.items()}
    if by_text:
        drawn[TEXT_ONLY] = gather(by_text)
    return _outcomes(canvases, goals, drawn)


def run_on_paper(cases: Sequence[Case], task: Task, submit: Submit) -> Outcomes:
    """Run the methods of `ON_PAPER`: whether a drawing shows what the prompt asks for, without anything else.

    The oracle is the robot's drawing of the scene itself: an upper bound of the scores.
    """
    captions = [case.caption for case in cases]
    papers = np.stack([task.blank] * len(cases))
    sheet = _blank_sheet(task)
    futures = {
        BASE: submit(_complete, task.planners.base, papers, captions, task),
        FINE_TUNED: submit(_complete, task.planners.fine_tuned, papers, captions, task),
    }
    true = [submit(_draw, task, sheet, case.image, i) for i, case in enumerate(cases)]
    goals = {name: future.result() for name, future in futures.items()}
    plans = {
        name: [submit(_plan, task, sheet, goal, i) for i, goal in enumerate(pictures)]
        for name, pictures in goals.items()
    }
    return _outcomes(papers, goals, {name: gather(of_one) for name, of_one in plans.items()} | {ORACLE: gather(true)})


def outcome_columns(outcomes: Outcomes) -> dict[str, Pictures]:
    """Columns for `sheets.side_by_side`: canvases, then the goal (if there is one) and the plan of each method."""
    columns = {"canvas": outcomes.canvases}
    for method, drawings in outcomes.drawings.items():
        if method in outcomes.goals:
            columns[f"{method}: goal"] = outcomes.goals[method]
        if method != NO_CHANGE:
            columns[f"{method}: plan"] = drawings
    return columns


def complete_canvases(
    planner: GoalPlanner, canvases: Pictures, captions: Sequence[str], sampling: SeededSampling
) -> Pictures:
    """Goals, uint8 [B, H, W, 3], for canvases and their prompts; where the planner changes nothing, the canvas itself.

    The autoencoder changes every pixel a little. Only what differs from the canvas's own reconstruction is a change.
    """
    completions = complete(planner, canvases, captions, sampling)
    return keep_canvas(canvases, completions, round_trip(planner.vae, canvases), planner.vae_scale_factor)


def complete_requests(
    planner: GoalPlanner,
    canvases: Pictures,
    captions: Sequence[str],
    sampling: SeededSampling,
    *,
    medium: str,
    has_ink: bool,
    vocabulary: Vocabulary | None,
    largest: float = 1.0,
) -> Pictures:
    """Goals, uint8 [B, H, W, 3], for canvases and requests without their medium, as the runner composes them.

    The first goal is that of the runner for the same canvas, request and seed.

    Args:
        has_ink: as for `drawn_in_windows`.
        vocabulary: what the planner was taught; None for one that knows all words.
        largest: as for `wishes_for`.
    """
    by_window = vocabulary is not None and vocabulary.by_window

    def goal(index: int, canvas: Pictures, caption: str) -> Pictures:
        def completed(small: Pictures, words: str, number: int) -> Pictures:
            seeded = replace(sampling, seed=sampling.seed + MAX_THINGS * index + number)
            return np.asarray(complete_canvases(planner, small[None], [words], seeded)[0])

        wishes = wishes_for(understand(caption, vocabulary), canvas, medium, by_window=by_window, largest=largest)
        return drawn_in_windows(canvas, wishes, side_px=canvas.shape[0], has_ink=has_ink, complete=completed)

    both = zip(canvases, captions, strict=True)
    return np.stack([goal(index, canvas, caption) for index, (canvas, caption) in enumerate(both)])


def _outcomes(canvases: Pictures, goals: dict[str, Pictures], drawn: dict[str, list[_Sheet]]) -> Outcomes:
    side = canvases.shape[1]
    drawings = {name: np.stack([as_picture(one.sheet, side) for one in of_one]) for name, of_one in drawn.items()}
    strokes = {name: [one.strokes for one in of_one] for name, of_one in drawn.items()}
    return Outcomes(canvases, goals, drawings | {NO_CHANGE: canvases}, strokes | {NO_CHANGE: [0] * len(canvases)})


@dataclass(frozen=True, eq=False)
class _Sheet:
    """The part of a plan that a worker returns."""

    sheet: Light
    strokes: int


def _without_plan(drawn: Drawn) -> _Sheet:
    return _Sheet(drawn.sheet, len(drawn.strokes))


def _start(task: Task, case: Case, in_full: bool, number: int) -> tuple[Light, Light]:
    """The started sheet, and that sheet with the prompt's scene drawn (if `in_full`); linear light [S, S, 3]."""
    other = seeded(task.begun_with, _seed(task.seed, number, 0))
    sheet = draw_scene(other, _blank_sheet(task), case.other_image, task.strokes.begun).sheet
    if not in_full:
        return sheet, sheet
    robot = seeded(task.paint_context, _seed(task.seed, number, 1))
    return sheet, draw_scene(robot, sheet, case.image, task.strokes.added).sheet


def _draw(task: Task, sheet: Light, image: Pictures, number: int) -> _Sheet:
    context = seeded(task.paint_context, _seed(task.seed, number, 1))
    return _without_plan(draw_scene(context, sheet, image, task.strokes.added))


def _plan(task: Task, sheet: Light, goal: Pictures, number: int) -> _Sheet:
    context = seeded(task.paint_context, _seed(task.seed, number, 2))
    return _without_plan(plan_goal(context, sheet, goal, task.strokes.added))


def _from_text(task: Task, sheet: Light, caption: str, number: int) -> _Sheet:
    return _without_plan(
        plan_text(
            task.paint_context, sheet, caption, encoder=_encoder(task.encoder), strokes=task.strokes.added,
            iterations=task.text_only.iterations, views=task.text_only.views, seed=_seed(task.seed, number, 3),
        )
    )  # fmt: skip


def _complete(folder: Path, inputs: Pictures, captions: Sequence[str], task: Task) -> Pictures:
    return complete_requests(
        load_goal_planner(folder), inputs, captions, task.sampling, medium=task.paint_context.medium.words,
        has_ink=task.paint_context.tool.color_srgb is not None, vocabulary=task.vocabulary,
    )  # fmt: skip


@cache
def _encoder(folder: Path) -> Encoder:
    return Encoder.load(folder)


def _blank_sheet(task: Task) -> Light:
    return as_sheet(task.blank, task.paint_context.medium.side_px)


def _seed(*key: int) -> int:
    """One number for a key such as (seed, case, kind of plan)."""
    return int(np.random.SeedSequence((len(key), *key)).generate_state(1)[0])
