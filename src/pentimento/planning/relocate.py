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
from pentimento.planning.initialise import guided_strokes
from pentimento.planning.scene import ErrorMap, Scene, marks_px, render_fixed
from pentimento.planning.strokes import StrokeTensors

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


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
    """[S] by how much the error, summed over pixels, rises when a stroke is left out; negative where it does harm.

    Exact up to what viewing distances smear beyond a stroke's own box. Strokes whose boxes do not touch are left out
    in one rendering, so that it takes tens of renderings, not one a stroke.
    """
    errors = ErrorMap(scene.target, config.distances_px)
    boxes = _boxes(strokes, scene, config)
    everyone = errors(render_fixed(strokes, canvas, scene, config.path_points))
    worth = np.zeros(len(strokes))
    for group in apart(boxes):
        others = torch.from_numpy(np.setdiff1d(np.arange(len(strokes)), group))
        rise = errors(render_fixed(strokes.pick(others), canvas, scene, config.path_points)) - everyone
        for s in group:
            r0, r1, c0, c1 = boxes[s]
            worth[s] = rise[r0:r1, c0:c1].sum()
    return worth


def apart(boxes: IntArray) -> list[list[int]]:
    """Boxes [S, 4] (r0, r1, c0, c1) in groups in which no two share a pixel."""
    r0, r1, c0, c1 = (edge[:, None] for edge in boxes.T)
    meet = (np.maximum(r0, r0.T) < np.minimum(r1, r1.T)) & (np.maximum(c0, c0.T) < np.minimum(c1, c1.T))
    group = np.full(len(boxes), -1)
    for s, touched in enumerate(meet):
        taken = set(group[:s][touched[:s]].tolist())
        group[s] = next(g for g in range(len(boxes)) if g not in taken)
    return [np.flatnonzero(group == g).tolist() for g in range(group.max(initial=-1) + 1)]


def _boxes(strokes: StrokeTensors, scene: Scene, config: PlannerConfig) -> IntArray:
    """[S, 4] first and last rows and columns (excluded) that a stroke can change, as seen from the distances."""
    with torch.no_grad():
        points, radius, _ = marks_px(strokes, scene, config.path_points)
        reach = radius.amax(1)[:, None] + max(config.distances_px) / 2
        low, high = (points.amin(1) - reach).floor(), (points.amax(1) + reach).ceil() + 1
    height, width = scene.target.shape[:2]
    limit = np.array([width, height])
    (c0, r0), (c1, r1) = (np.clip(edge.numpy(), 0, limit).astype(np.int64).T for edge in (low, high))
    return np.stack([r0, r1, c0, c1], axis=1)
