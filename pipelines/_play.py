"""Stories drawn in turns in the studio: a person begins, the robot continues (thesis 6.6.2)."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pentimento.bundle.vocabulary import Vocabulary
from pentimento.control.guard import GuardedRobot
from pentimento.control.safety import envelope_for
from pentimento.copainting.evaluation.codraw import Codrawing, Story, Turn, codraw
from pentimento.copainting.evaluation.goal_plans import Medium, PaintContext
from pentimento.copainting.evaluation.methods import complete_requests
from pentimento.copainting.goal.planner import SeededSampling, load_goal_planner
from pentimento.robots.driver import Robot
from pentimento.robots.virtual import VirtualRobot
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import load_world

Picture = NDArray[np.uint8]


@dataclass(frozen=True)
class EvaluatedSetting:
    """What the robot draws with in one setting, and where."""

    world: str
    """The studio's, in which person and robot draw in turns."""
    medium: Medium


def play(
    folder: Path,
    story: Story,
    paint_context: PaintContext,
    *,
    world: str,
    sampling: SeededSampling,
    codrawing: Codrawing,
    vocabulary: Vocabulary | None,
    seed: int,
) -> list[Turn]:
    """Draw one story on a new sheet in the studio; the goal planner in `folder` sets the robot's goals."""
    planner = load_goal_planner(folder)

    def goal_for(photo: Picture, prompt: str) -> Picture:
        goals = complete_requests(
            planner, photo[None], [prompt], sampling, medium=paint_context.medium.words,
            has_ink=paint_context.tool.color_srgb is not None, vocabulary=vocabulary,
            largest=codrawing.largest,
        )  # fmt: skip
        return np.asarray(goals[0])

    return codraw(_robot(paint_context, world, seed), paint_context, story, goal_for, config=codrawing, seed=seed)


def _robot(paint_context: PaintContext, world: str, seed: int) -> Robot:
    """Return a robot with a blank sheet of the medium's size."""
    known = load_world(world)
    side = paint_context.medium.side_m
    studio = Studio(replace(known, paper=replace(known.paper, size_m=(side, side))), seed)
    robot = VirtualRobot(studio)
    return GuardedRobot(robot, envelope_for(paint_context.tool, robot.canvas_size_m))
