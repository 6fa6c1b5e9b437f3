"""The end of a plan: strokes moved down the print objective and what the picture should mean, together (thesis 4.5)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from pentimento.contracts.ranges import above_zero, at_least
from pentimento.planning.config import Log, PlannerConfig
from pentimento.planning.descent import half_cosine
from pentimento.planning.objectives.weighted import Objective, Term, WeightedObjective
from pentimento.planning.scene import Scene, inherit, objective_for, render_plan
from pentimento.planning.strokes import StrokeTensors

_BETAS = (0.85, 0.97)
"""Adam's memory, short as the descent is."""


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
    strokes: StrokeTensors,
    canvas: Tensor,
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
    rates = config.learning_rates
    groups = [
        (strokes.middle_m, rates.middle_m),
        (strokes.theta_rad, rates.theta_rad),
        (strokes.length_m, rates.length_m),
        (strokes.bend_m, rates.bend_m),
        (strokes.press_m, rates.press_m),
    ]
    strokes.inherited = inherit(strokes, scene, config.path_points)
    for tensor, _ in groups:
        tensor.requires_grad_(True)
    optimiser = torch.optim.Adam([{"params": [tensor], "lr": rate} for tensor, rate in groups], betas=_BETAS)
    for iteration in range(guidance.iterations):
        share = half_cosine(iteration, guidance.iterations, guidance.rate, 0.0)
        for group, (_, rate) in zip(optimiser.param_groups, groups, strict=True):
            group["lr"] = share * rate
        optimiser.zero_grad()
        loss = objective(render_plan(strokes, canvas, scene, config.path_points))
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        strokes.keep_within(scene.tool, scene.canvas_size_m, config.edge_m)
        log("guided", float(loss.detach()), iteration)
    for tensor, _ in groups:
        tensor.requires_grad_(False)
