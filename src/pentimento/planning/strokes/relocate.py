"""Useless strokes are moved to where they lower the error (the thesis's planner leaves them where they started).

Gradients cannot do this: a stroke that is hidden, or that repeats what lies under it, has no gradient. The contribution
of each stroke is therefore measured by leaving it out, and compared with the gain of a new stroke.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pentimento.planning.strokes.config import PlanConfig
from pentimento.planning.strokes.families import PathFamily
from pentimento.planning.strokes.initialise import alone_px
from pentimento.planning.strokes.paths import PlannedPaths
from pentimento.planning.strokes.render_plan import render_plan
from pentimento.planning.strokes.scene import Scene
from pentimento.render.strokewise import rise_without

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]
S = TypeVar("S", bound=PlannedPaths)


def relocate(
    strokes: S, canvas: Array, scene: Scene, *, config: PlanConfig, family: PathFamily[S],
    paints: FloatArray | None, rng: np.random.Generator,
) -> tuple[S, int]:  # fmt: skip
    """The strokes with the least useful of them replaced by new ones on top, and the number of replaced strokes.

    At most ``config.relocate_share`` of them are replaced, each only if the new stroke's gain exceeds the old one's
    contribution. The others keep their order. See ``PathFamily.guided`` for ``paints``.
    """
    largest = int(len(strokes) * config.relocate_share)
    if largest == 0:
        return strokes, 0
    image = render_plan(strokes, canvas, scene)
    worth = contributions(strokes, canvas, scene, config)
    new, gains = family.guided(
        largest, image, scene, distances_px=config.distances_px, progress=1.0, paints=paints, rng=rng
    )
    useless, best = np.argsort(worth, kind="stable")[:largest], np.argsort(-gains, kind="stable")
    better = gains[best] > np.maximum(worth[useless], 0.0)
    moved = largest if better.all() else int(better.argmin())
    staying = np.setdiff1d(np.arange(len(strokes)), useless[:moved])
    return strokes.pick(staying).joined(new.pick(best[:moved])), moved


def contributions(strokes: PlannedPaths, canvas: Array, scene: Scene, config: PlanConfig) -> FloatArray:
    """[S] rise of the error, summed over pixels, when a stroke is left out. Negative where the stroke does harm."""
    return rise_without(alone_px(strokes, scene), canvas, scene.target, distances=config.distances_px)


def without_useless(strokes: S, canvas: Array, scene: Scene, config: PlanConfig) -> S:
    """The strokes without those that lower the objective by less than ``config.min_gain_per_stroke``; if that is 0
    or None, without those that raise it.

    Each round removes the worse half of them, because removing one stroke can make another useful. Without a print
    objective, which tells the use of a single stroke, all strokes stay.
    """
    if config.objectives.print_weight == 0:
        return strokes
    least = (config.min_gain_per_stroke or 0.0) * scene.target.shape[0] * scene.target.shape[1]
    left = strokes.pick(slice(None))
    while len(left):
        left.inherited = None  # positions in the plan have changed
        worth = contributions(left, canvas, scene, config)
        useless = np.flatnonzero(worth < least)
        if not len(useless):
            break
        worst = useless[np.argsort(worth[useless], kind="stable")][: (len(useless) + 1) // 2]
        left = left.pick(np.setdiff1d(np.arange(len(left)), worst))
    left.inherited = None
    return left
