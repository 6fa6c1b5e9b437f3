"""Table 6.1 of the thesis: what each way of answering a prompt on a begun canvas makes of it, and at what gap.

Every method gives a goal picture, and the Low-Level Action Planner foretells what the robot will make of it. Scores are
of the foretold drawing, gaps between it and the goal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.ranges import at_least
from pentimento.control.goal import keep_canvas
from pentimento.copainting.evaluation.cases import Case
from pentimento.copainting.evaluation.goal_plans import PaintContext, draw_scene, laid_out, plan_goal, seeded, seen
from pentimento.copainting.evaluation.text_guided import plan_text
from pentimento.copainting.goal.planner import GoalPlanner, complete, load_goal_planner
from pentimento.copainting.goal.vae import round_trip
from pentimento.copainting.workers import Submit, gather
from pentimento.semantics.encoder import Encoder

Pictures = NDArray[np.uint8]
Light = NDArray[np.float32]
Made: TypeAlias = tuple[Light, int]
"""A sheet [S, S, 3] in linear light, and the number of strokes that made it."""

NO_CHANGE: Final = "no_change"
COPY: Final = "copy_input"
IGNORE: Final = "ignore_input"
TEXT_ONLY: Final = "text_only"
BASE: Final = "base"
FINE_TUNED: Final = "fine_tuned"
ORACLE: Final = "oracle"
ON_CANVAS: Final = (NO_CHANGE, COPY, IGNORE, TEXT_ONLY, BASE, FINE_TUNED, ORACLE)
"""Methods on a begun canvas: nothing drawn; the input taken for the goal; the base asked without the canvas; no goal
planner; the base; the fine-tuned planner; the true full drawing taken for the goal."""
FROM_BLANK: Final = (NO_CHANGE, BASE, FINE_TUNED, ORACLE)
"""Methods on blank paper."""


@dataclass(frozen=True)
class Asking:
    """How goal planners are asked."""

    steps: int
    image_guidance: float
    text_guidance: float
    seed: int

    def __post_init__(self) -> None:
        at_least(self, 1, "steps", "image_guidance", "text_guidance")
        at_least(self, 0, "seed")


@dataclass(frozen=True)
class TextOnly:
    """How the planner draws from words alone."""

    iterations: int
    views: int
    """Of the picture, beside the plain one, at each iteration."""

    def __post_init__(self) -> None:
        at_least(self, 0, "iterations", "views")


@dataclass(frozen=True)
class Strokes:
    """How many strokes are drawn."""

    begun: int
    """Of the other prompt's drawing on the canvas (thesis 6.6.1: 35)."""
    added: int
    """By the robot, at most."""

    def __post_init__(self) -> None:
        at_least(self, 1, "begun", "added")


@dataclass(frozen=True, eq=False)
class Answers:
    """What each method made of each case; pictures are uint8 [B, H, W, 3]."""

    canvases: Pictures
    goals: dict[str, Pictures]
    """Of methods that have one."""
    drawings: dict[str, Pictures]
    """The foretold sheets."""
    strokes: dict[str, list[int]]
    """In each plan."""


@dataclass(frozen=True)
class Planners:
    """Folders of the goal planners."""

    base: Path
    fine_tuned: Path


@dataclass(frozen=True)
class Task:
    """What is the same for all cases."""

    paint_context: PaintContext
    """The robot's."""
    begun_with: PaintContext
    """What the begun canvases are drawn with; the robot's, or another medium (thesis 6.6.4) on an equal sheet."""
    blank: Pictures
    """A sheet of paper, uint8 [H, W, 3], as large as the goal planners' pictures."""
    planners: Planners
    encoder: Path
    """Folder of the encoder that guides the method without a goal planner."""
    strokes: Strokes
    asking: Asking
    text_only: TextOnly
    seed: int
    """Of all plans; each depends on (seed, case) only, whatever the number of workers."""


def answer_on_canvas(cases: Sequence[Case], task: Task, methods: Sequence[str], submit: Submit) -> Answers:
    """Methods of `ON_CANVAS` on canvases that hold drawings of other prompts, by jobs that are submitted."""
    side, numbers = task.blank.shape[0], range(len(cases))
    captions = [case.caption for case in cases]
    begun = gather([submit(_begin, task, case, ORACLE in methods, i) for i, case in enumerate(cases)])
    sheets = [sheet for sheet, _ in begun]
    canvases = np.stack([seen(sheet, side) for sheet in sheets])
    papers = np.stack([task.blank] * len(cases))
    asked = {
        name: submit(_complete, folder, shown, captions, task.asking)
        for name, folder, shown in (
            (BASE, task.planners.base, canvases),
            (FINE_TUNED, task.planners.fine_tuned, canvases),
            (IGNORE, task.planners.base, papers),
        )
        if name in methods
    }
    words = [
        submit(_from_words, task, sheet, caption, i)
        for i, sheet, caption in zip(numbers, sheets, captions, strict=True)
        if TEXT_ONLY in methods
    ]
    goals = {name: future.result() for name, future in asked.items()}
    if COPY in methods:
        goals[COPY] = canvases
    if ORACLE in methods:
        goals[ORACLE] = np.stack([seen(full, side) for _, full in begun])
    plans = {
        name: [submit(_plan, task, sheet, goal, i) for i, sheet, goal in zip(numbers, sheets, pictures, strict=True)]
        for name, pictures in goals.items()
    }
    made = {name: gather(futures) for name, futures in plans.items()}
    if words:
        made[TEXT_ONLY] = gather(words)
    return _answers(canvases, goals, made)


def answer_on_paper(cases: Sequence[Case], task: Task, submit: Submit) -> Answers:
    """The methods of `FROM_BLANK`: whether what is asked for appears, with nothing else about.

    The oracle is the scene itself, drawn by the robot: what a judge makes of a drawing that shows what was asked for.
    """
    captions = [case.caption for case in cases]
    papers = np.stack([task.blank] * len(cases))
    sheet = _sheet(task)
    asked = {
        BASE: submit(_complete, task.planners.base, papers, captions, task.asking),
        FINE_TUNED: submit(_complete, task.planners.fine_tuned, papers, captions, task.asking),
    }
    true = [submit(_draw, task, sheet, case.image, i) for i, case in enumerate(cases)]
    goals = {name: future.result() for name, future in asked.items()}
    plans = {
        name: [submit(_plan, task, sheet, goal, i) for i, goal in enumerate(pictures)]
        for name, pictures in goals.items()
    }
    made = {name: gather(futures) for name, futures in plans.items()} | {ORACLE: gather(true)}
    return _answers(papers, goals, made)


def _answers(canvases: Pictures, goals: dict[str, Pictures], made: dict[str, list[Made]]) -> Answers:
    side = canvases.shape[1]
    drawings = {name: np.stack([seen(sheet, side) for sheet, _ in of]) for name, of in made.items()}
    strokes = {name: [count for _, count in of] for name, of in made.items()}
    unchanged = [0] * len(canvases)
    return Answers(canvases, goals, drawings | {NO_CHANGE: canvases}, strokes | {NO_CHANGE: unchanged})


def _begin(task: Task, case: Case, in_full: bool, number: int) -> tuple[Light, Light]:
    """The begun sheet, and the same with the prompt's scene drawn in full (if asked for); linear light [S, S, 3]."""
    with_ = _seeded(task.begun_with, task.seed, number, 0)
    sheet = draw_scene(with_, _sheet(task), case.other_image, task.strokes.begun).sheet
    if not in_full:
        return sheet, sheet
    full = draw_scene(_seeded(task.paint_context, task.seed, number, 1), sheet, case.image, task.strokes.added).sheet
    return sheet, full


def _draw(task: Task, sheet: Light, image: Pictures, number: int) -> Made:
    own = _seeded(task.paint_context, task.seed, number, 1)
    made = draw_scene(own, sheet, image, task.strokes.added)
    return made.sheet, len(made.strokes)


def _plan(task: Task, sheet: Light, goal: Pictures, number: int) -> Made:
    own = _seeded(task.paint_context, task.seed, number, 2)
    made = plan_goal(own, sheet, goal, task.strokes.added)
    return made.sheet, len(made.strokes)


def _from_words(task: Task, sheet: Light, caption: str, number: int) -> Made:
    made = plan_text(
        task.paint_context, sheet, caption, _encoder(task.encoder), task.strokes.added,
        task.text_only.iterations, task.text_only.views, _seed(task.seed, number, 3),
    )  # fmt: skip
    return made.sheet, len(made.strokes)


def _complete(folder: Path, inputs: Pictures, captions: Sequence[str], asking: Asking) -> Pictures:
    return ask(load_goal_planner(folder), inputs, captions, asking)


def ask(planner: GoalPlanner, inputs: Pictures, captions: Sequence[str], asking: Asking) -> Pictures:
    """Goals, uint8 [B, H, W, 3], for canvases of that size and their prompts; what the planner leaves is the canvas."""
    guidances = asking.image_guidance, asking.text_guidance
    made = complete(planner, inputs, captions, asking.steps, *guidances, asking.seed)
    return keep_canvas(inputs, made, round_trip(planner.vae, inputs), planner.vae_scale_factor)


@cache
def _encoder(folder: Path) -> Encoder:
    return Encoder.load(folder)


def _sheet(task: Task) -> Light:
    return laid_out(task.blank, task.paint_context.medium.side_px)


def _seeded(paint_context: PaintContext, *key: int) -> PaintContext:
    return seeded(paint_context, _seed(*key))


def _seed(*key: int) -> int:
    """One number for a key such as (seed, case, kind of plan)."""
    return int(np.random.SeedSequence((len(key), *key)).generate_state(1)[0])
