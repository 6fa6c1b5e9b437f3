"""The end of a plan: strokes moved down the print objective and what the picture should mean, together (thesis 4.5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.ranges import above_zero, at_least
from pentimento.planning.objectives import Objective, Term, WeightedObjective
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.config import Log, PlannerConfig
from pentimento.planning.strokes.descent import descend
from pentimento.planning.strokes.scene import Scene, objective_for

Light = NDArray[np.float32]


@dataclass(frozen=True)
class Guidance:
    """How much a plan is guided by what the picture means, after it was planned as a likeness."""

    weight: float
    """Of the semantic objective beside the planner's own."""
    iterations: int
    rate: float
    """Share of the planner's learning rates, at the start; it falls to 0."""
    views: int
    """Of the picture, moved at random, at each iteration, beside the plain one."""

    def __post_init__(self) -> None:
        above_zero(self, "weight", "rate")
        at_least(self, 1, "iterations")
        at_least(self, 0, "views")


def descend_guided(
    strokes: Strokes,
    canvas: Light,
    scene: Scene,
    config: PlannerConfig,
    meaning: Objective,
    guidance: Guidance,
    log: Log,
) -> None:
    """Move the strokes, in place, down both objectives; colours stay, they are paints by now.

    The objective is seen through other views at each iteration, so its values do not compare: strokes end where the
    falling rate leaves them. ``log("guided", value, iteration)`` is called at every iteration.
    """
    own = Term("planned", 1.0, objective_for(scene, config))
    objective = WeightedObjective((own, Term("meaning", guidance.weight, meaning)))
    way = descend(strokes, canvas, scene, config, objective, guidance.iterations, False, guidance.rate)
    for iteration, value in enumerate(way):
        log("guided", value, iteration)
