"""A drawing from words alone: the Low-Level Action Planner guided by the text objective (thesis 4.1, 6.5.1)."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from pentimento.copainting.evaluation.goal_plans import Drawn, Easel, foretold
from pentimento.planning.descent import half_cosine
from pentimento.planning.initialise import random_strokes
from pentimento.planning.scene import render_plan
from pentimento.planning.strokes import with_color
from pentimento.semantics.encoder import Encoder
from pentimento.semantics.objective import TextObjective
from pentimento.stroke_dynamics.photometry import linear_to_srgb

_BETAS = (0.85, 0.97)  # as the planner's: runs are short


def plan_text(
    easel: Easel, sheet: Tensor, caption: str, encoder: Encoder, strokes: int, iterations: int, views: int, seed: int
) -> Drawn:
    """Strokes from random places down the text objective, on a sheet [S, S, 3] in linear light.

    The thesis's baseline without a goal planner: nothing but the words says what to draw. The plan of the lowest
    objective on the way is kept.
    """
    medium, config = easel.medium, easel.medium.planner
    scene = easel.scene(sheet)
    made = random_strokes(strokes, easel.tool, scene.canvas_size_m, np.random.default_rng([seed, 0]))
    if easel.tool.color_srgb is not None:
        made = with_color(made, torch.tensor(easel.tool.color_srgb).expand(strokes, 3))
    made.keep_within(easel.tool, scene.canvas_size_m, config.edge_m)
    rates = config.learning_rates
    groups = [
        (made.middle_m, rates.middle_m),
        (made.theta_rad, rates.theta_rad),
        (made.length_m, rates.length_m),
        (made.bend_m, rates.bend_m),
        (made.press_m, rates.press_m),
    ]
    if easel.tool.color_srgb is None:
        groups.append((made.color, rates.color))
    objective = TextObjective(encoder, caption, views, seed)
    for tensor, _ in groups:
        tensor.requires_grad_(True)
    optimiser = torch.optim.Adam([{"params": [tensor], "lr": rate} for tensor, rate in groups], betas=_BETAS)
    least, best = float("inf"), made.pick(slice(None))
    for iteration in range(iterations + 1):
        optimiser.zero_grad()
        loss = objective(render_plan(made, sheet, scene, config.path_points))
        if float(loss.detach()) < least:
            least, best = float(loss.detach()), made.pick(slice(None))
        if iteration == iterations:
            break
        for group, (_, rate) in zip(optimiser.param_groups, groups, strict=True):
            group["lr"] = half_cosine(iteration, iterations, rate, 0.0)
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        made.keep_within(easel.tool, (medium.side_m, medium.side_m), config.edge_m)
    palette = linear_to_srgb(best.color).double().numpy()  # a paint for each stroke, where colours are free
    return Drawn(best, foretold(best, sheet, scene, config.path_points), np.unique(palette, axis=0))
