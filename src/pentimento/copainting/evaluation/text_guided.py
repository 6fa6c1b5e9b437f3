"""A drawing from words alone: the Low-Level Action Planner guided by the text objective (thesis 4.1, 6.5.1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb
from pentimento.copainting.evaluation.goal_plans import Drawn, PaintContext, predicted
from pentimento.planning.strokes.bezier import with_color
from pentimento.planning.strokes.descent import descend
from pentimento.planning.strokes.initialise import random_strokes
from pentimento.planning.strokes.render_plan import render_plan
from pentimento.semantics.encoder import Encoder
from pentimento.semantics.objective import TextObjective
from pentimento.semantics.style.torch_objective import TorchObjective

Light = NDArray[np.float32]


def plan_text(
    paint_context: PaintContext,
    sheet: Light,
    caption: str,
    encoder: Encoder,
    strokes: int,
    iterations: int,
    views: int,
    seed: int,
) -> Drawn:
    """Strokes from random places down the text objective, on a sheet [S, S, 3] in linear light.

    The thesis's baseline without a goal planner: nothing but the words says what to draw. The plan of the lowest
    objective on the way is kept.
    """
    config, tool = paint_context.medium.planner, paint_context.tool
    scene = paint_context.scene(sheet)
    made = random_strokes(strokes, tool, scene.canvas_size_m, np.random.default_rng([seed, 0]))
    if tool.color_srgb is not None:
        made = with_color(made, np.tile(np.array(tool.color_srgb, np.float32), (strokes, 1)))
    made.keep_within(tool, scene.canvas_size_m, config.edge_m)
    objective = TorchObjective(TextObjective(encoder, caption, views, seed))
    minimum, best = np.inf, made.pick(slice(None))
    for value in descend(made, sheet, scene, config, objective, iterations, tool.color_srgb is None, 1.0):
        if value < minimum:
            minimum, best = value, made.pick(slice(None))
    if objective(render_plan(made, sheet, scene))[0] < minimum:
        best = made
    best.inherited = None
    palette = linear_to_srgb(best.color).astype(np.float64)  # a paint for each stroke, where colours are free
    return Drawn(best, predicted(best, sheet, scene), np.unique(palette, axis=0))
