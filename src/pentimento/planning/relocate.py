"""Strokes that do nothing for the picture go where they would (the thesis's planner leaves them where they started).

Gradients cannot do this: a stroke that is hidden, or that repeats what lies under it, feels no pull. So each stroke's
worth is measured by leaving it out, and compared with what a new stroke would be worth where the picture is wrong.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pentimento.planning.config import PlannerConfig
from pentimento.planning.initialise import guided_strokes, stroke_arrays
from pentimento.planning.scene import Scene, render_fixed
from pentimento.planning.strokes import StrokeTensors
from pentimento.render.strokewise import rise_without

FloatArray = NDArray[np.float64]


def relocate(
    strokes: StrokeTensors,
    canvas: Tensor,
    scene: Scene,
    config: PlannerConfig,
    paints: FloatArray | None,
    rng: np.random.Generator,
) -> tuple[StrokeTensors, int]:
    """The strokes with the least useful of them moved to the top, where they lower the error more, and how many moved.

    At most ``config.relocate_share`` of them move, each only if its new place is worth more than its old one. Strokes
    that stay keep their order. See ``guided_strokes`` for ``paints``.
    """
    most = int(len(strokes) * config.relocate_share)
    if most == 0:
        return strokes, 0
    image = render_fixed(strokes, canvas, scene, config.path_points)
    worth = contributions(strokes, canvas, scene, config)
    new, gains = guided_strokes(most, config.sizes[1], torch.from_numpy(image), scene, config, paints, rng)
    idle, best = np.argsort(worth, kind="stable")[:most], np.argsort(-gains, kind="stable")
    better = gains[best] > np.maximum(worth[idle], 0.0)
    moved = most if better.all() else int(better.argmin())
    staying = np.setdiff1d(np.arange(len(strokes)), idle[:moved])
    return strokes.pick(torch.from_numpy(staying)).joined(new.pick(torch.from_numpy(best[:moved].copy()))), moved


def contributions(strokes: StrokeTensors, canvas: Tensor, scene: Scene, config: PlannerConfig) -> FloatArray:
    """[S] by how much the error, summed over pixels, rises when a stroke is left out; negative where it does harm."""
    return rise_without(*stroke_arrays(strokes, canvas, scene, config))
