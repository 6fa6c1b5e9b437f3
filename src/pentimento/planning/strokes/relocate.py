"""Strokes that do nothing for the picture go where they would (the thesis's planner leaves them where they started).

Gradients cannot do this: a stroke that is hidden, or that repeats what lies under it, feels no pull. So each stroke's
worth is measured by leaving it out, and compared with what a new stroke would be worth where the picture is wrong.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.config import PlannerConfig
from pentimento.planning.strokes.initialise import guided_strokes, stroke_arrays
from pentimento.planning.strokes.render_plan import render_plan
from pentimento.planning.strokes.scene import Scene
from pentimento.render.strokewise import rise_without

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]


def relocate(
    strokes: Strokes,
    canvas: Array,
    scene: Scene,
    config: PlannerConfig,
    paints: FloatArray | None,
    rng: np.random.Generator,
) -> tuple[Strokes, int]:
    """The strokes with the least useful of them moved to the top, where they lower the error more, and how many moved.

    At most ``config.relocate_share`` of them move, each only if its new place is worth more than its old one. Strokes
    that stay keep their order. See ``guided_strokes`` for ``paints``.
    """
    most = int(len(strokes) * config.relocate_share)
    if most == 0:
        return strokes, 0
    image = render_plan(strokes, canvas, scene)
    worth = contributions(strokes, canvas, scene, config)
    new, gains = guided_strokes(most, config.sizes[1], image, scene, config, paints, rng)
    idle, best = np.argsort(worth, kind="stable")[:most], np.argsort(-gains, kind="stable")
    better = gains[best] > np.maximum(worth[idle], 0.0)
    moved = most if better.all() else int(better.argmin())
    staying = np.setdiff1d(np.arange(len(strokes)), idle[:moved])
    return strokes.pick(staying).joined(new.pick(best[:moved])), moved


def contributions(strokes: Strokes, canvas: Array, scene: Scene, config: PlannerConfig) -> FloatArray:
    """[S] by how much the error, summed over pixels, rises when a stroke is left out; negative where it does harm."""
    return rise_without(*stroke_arrays(strokes, canvas, scene, config))


def without_harmful(strokes: Strokes, canvas: Array, scene: Scene, config: PlannerConfig) -> Strokes:
    """The strokes but those whose absence lowers the error.

    A goal that needs few strokes is not spoilt by the many that were allowed. Of strokes that do harm together, each
    round leaves out the worst half, since without them the others may be needed.
    """
    left = strokes.pick(slice(None))
    while len(left):
        left.inherited = None  # others were left out, so that they stand elsewhere
        worth = contributions(left, canvas, scene, config)
        harmful = np.flatnonzero(worth < 0)
        if not len(harmful):
            break
        worst = harmful[np.argsort(worth[harmful], kind="stable")][: (len(harmful) + 1) // 2]
        left = left.pick(np.setdiff1d(np.arange(len(left)), worst))
    left.inherited = None
    return left
