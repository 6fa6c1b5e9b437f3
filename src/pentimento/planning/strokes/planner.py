"""Plans of strokes: added coarse to fine, moved by gradients, relocated where useless, then painted in few paints.

One planner serves every kind of stroke (``PathFamily``). The thesis's planner for paintings (4.3.5, Figure 4.5) is the
case of random strokes in one round, no relocation and one sweep; its planner for handwriting (5.3.6) that of random
latents.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import srgb_to_linear
from pentimento.contracts.errors import ConfigError
from pentimento.planning.adam import half_cosine
from pentimento.planning.strokes.bezier import Strokes, no_strokes
from pentimento.planning.strokes.config import PRINT_ALONE, Log, PlanConfig, PlannerConfig, ShapedPlanConfig
from pentimento.planning.strokes.descent import optimise
from pentimento.planning.strokes.families import BezierFamily, PathFamily, family_of, shaped_family
from pentimento.planning.strokes.lines import line_strokes
from pentimento.planning.strokes.paints import Paints, check_palette, choose_paints, in_order, repaint
from pentimento.planning.strokes.paths import PlannedPaths
from pentimento.planning.strokes.relocate import relocate, without_useless
from pentimento.planning.strokes.render_plan import render_plan
from pentimento.planning.strokes.scene import Scene, halved, objective_for
from pentimento.planning.strokes.shapes import ShapedStrokes, Shapes

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]
S = TypeVar("S", bound=PlannedPaths)

_ROUND_END = 0.3
"""Share of the learning rates at the end of a round. The next round continues with it."""
_COARSE = 0.5
"""Share of the free iterations, from the first, at half the resolution: strokes are still far from their places."""
_SETTLE = 0.15
"""Share of the iterations, up to the last, without relocation and change of paint: the strokes converge."""
_PAINT_RATE = 0.5
"""Share of the learning rates with which strokes adapt to paints."""


@dataclass(frozen=True)
class Draft(Generic[S]):
    """A plan in progress."""

    strokes: S
    paints: Paints | None
    """None while colours are free, and for a tool with its own ink."""


@dataclass(frozen=True)
class Planner(Generic[S]):
    """What all steps of one plan share."""

    canvas: Array
    """[H, W, 3], linear light, under the strokes."""
    scene: Scene
    config: PlanConfig
    family: PathFamily[S]
    rng: np.random.Generator
    log: Log

    def coarse(self) -> Planner[S]:
        """The same plan at half the resolution and viewing distance, where the configuration has a coarse part."""
        if not self.config.coarse_first:
            return self
        scene = replace(self.scene, target=halved(self.scene.target))
        distances = tuple(dict.fromkeys(max(distance // 2, 1) for distance in self.config.distances_px))
        config = replace(self.config, distances_px=distances, pixels_per_m=self.config.pixels_per_m / 2)
        return replace(self, canvas=halved(self.canvas), scene=scene, config=config)


def plan(canvas: Array, scene: Scene, count: int, config: PlannerConfig, log: Log) -> tuple[Strokes, FloatArray]:
    """Up to ``count`` Bézier strokes in the order of execution, and their palette, sRGB [K, 3] from light to dark.

    ``log("objective", value, iteration)`` is called at every iteration.

    Raises:
        ConfigError: palette or initialisation do not fit the tool, or the picture is smaller than a viewing distance.
        ImageError: the palette's picture does not exist.
    """
    check_palette(config.palette, scene.tool)
    rng = np.random.default_rng([config.seed, 0])
    strokes = free_plan(canvas, scene, count, config, rng=rng, log=log)
    planner = Planner(canvas, scene, config, BezierFamily(config, count), rng, log)
    return _in_paints(planner, strokes, config.rounds * config.iterations_per_round + config.iterations_free)


def free_plan(
    canvas: Array, scene: Scene, count: int, config: PlannerConfig, *, rng: np.random.Generator, log: Log
) -> Strokes:
    """Up to ``count`` Bézier strokes, each in a colour of its own, in the order in which they were added.

    The first pass reproduces the target by the print objective alone, since style, words and meaning do not say where
    strokes belong (thesis 4.5.3). The second one minimises all objectives.
    """
    first_config = replace(config, objectives=PRINT_ALONE)
    begun = no_strokes()
    if config.initialisation == "lines":
        begun = line_strokes(count, canvas, scene)
        begun.keep_within(scene.tool, scene.canvas_size_m, config.edge_m)
    family = BezierFamily(config, count - len(begun))
    strokes = _in_rounds(Planner(canvas, scene, first_config, family, rng, log), begun)
    planner, done = Planner(canvas, scene, config, family, rng, log), config.rounds * config.iterations_per_round
    strokes = _in_stretches(planner, Draft(strokes, None), config.iterations_free, rate=1.0, done=done).strokes
    # Lines that are drawn need no strokes beside them, however many are allowed.
    return without_useless(strokes, canvas, scene, config) if config.initialisation == "lines" else strokes


def plan_strokes(
    canvas: Array, scene: Scene, count: int, *, config: PlanConfig, shapes: Shapes | None, log: Log
) -> tuple[PlannedPaths, FloatArray]:
    """``plan``, or with ``shapes`` ``plan_shapes`` with as much line as ``count`` strokes of the tool's middle length.

    Raises:
        ConfigError: as those; or shapes and the kind of configuration do not fit.
    """
    if shapes is None and isinstance(config, PlannerConfig):
        return plan(canvas, scene, count, config, log)
    if shapes is None or not isinstance(config, ShapedPlanConfig):
        raise ConfigError("Strokes of one kind of shape need a ShapedPlanConfig, and Bézier strokes a PlannerConfig.")
    ink_m = count * sum(scene.tool.stroke_length_m) / 2
    return plan_shapes(canvas, scene, shapes, ink_m, config=config, log=log)


def plan_shapes(
    canvas: Array, scene: Scene, shapes: Shapes, ink_m: float, *, config: ShapedPlanConfig, log: Log
) -> tuple[ShapedStrokes, FloatArray]:
    """Strokes of one kind of shape in the order of execution, about ``ink_m`` of line, and their palette, sRGB [K, 3]
    from light to dark.

    Kinds of shape are compared at equal length of line, since a hundred dots are less than a hundred arcs. The last
    iterations may change the length a little. ``log("objective", value, iteration)`` is called at every iteration.

    Raises:
        ConfigError: the palette does not fit the tool, the brush takes Bézier strokes only, or brush, shapes and
            configuration differ in the number of points.
    """
    check_palette(config.palette, scene.tool)
    if not shapes.points == scene.brush.path_points == config.path_points:
        raise ConfigError(
            f"Shapes of {shapes.points} points, a brush of {scene.brush.path_points} and path_points = "
            f"{config.path_points} do not fit: train the shapes at that number of points."
        )
    rng = np.random.default_rng([config.seed, 21])
    planner = Planner(canvas, scene, config, shaped_family(shapes, ink_m, config, rng), rng, log)
    first = replace(planner, config=replace(config, objectives=PRINT_ALONE))
    draft, done = Draft(_in_rounds(first, planner.family.none()), None), config.rounds * config.iterations_per_round
    strokes = _in_stretches(planner, draft, config.iterations, rate=1.0, done=done).strokes
    return _in_paints(planner, strokes, done + config.iterations)


def relocated(strokes: S, canvas: Array, scene: Scene, config: PlanConfig, *, palette_srgb: FloatArray) -> S:
    """The strokes with useless ones relocated in these paints, sRGB [K, 3]: on top, from light to dark.

    The others keep their order, for which they were optimised.
    """
    paints = srgb_to_linear(np.asarray(palette_srgb, dtype=np.float64))
    family, rng = family_of(strokes, config), np.random.default_rng([config.seed, 6, scene.start.made])
    moved, count = relocate(strokes, canvas, scene, config=config, family=family, paints=paints, rng=rng)
    on_top = moved.color[len(moved) - count :].mean(1)
    order = np.argsort(-on_top, kind="stable") + len(moved) - count
    return moved.pick(np.concatenate([np.arange(len(moved) - count), order]))


def _in_paints(planner: Planner[S], strokes: S, done: int) -> tuple[S, FloatArray]:
    """Strokes in free colours painted in few paints, and these, sRGB [K, 3]; a tool with ink keeps it.

    Args:
        done: iterations before these, for ``log``.
    """
    scene, config = planner.scene, planner.config
    if scene.tool.color_srgb is not None:
        return strokes, np.array([scene.tool.color_srgb])
    paints = choose_paints(strokes, scene, config.palette, config.seed)
    draft = Draft(*in_order(paints.dipped(strokes), paints, scene, config))
    draft = _in_stretches(planner, draft, config.iterations_palette, rate=_PAINT_RATE, done=done)
    assert draft.paints is not None
    strokes, paints = in_order(draft.strokes, draft.paints, scene, config)
    return strokes, paints.srgb()


def _in_rounds(planner: Planner[S], strokes: S) -> S:
    """Strokes added to the given ones round by round, each round where the picture is still wrong, and optimised
    together."""
    planner = planner.coarse()
    canvas, scene, config, family = planner.canvas, planner.scene, planner.config, planner.family
    objective = objective_for(scene, config)
    before = objective(render_plan(strokes, canvas, scene))[0]
    for number in range(config.rounds):
        count = family.count_in_round(number, strokes)
        if count is None:
            continue
        new = family.initial(
            count, render_plan(strokes, canvas, scene), scene, distances_px=config.distances_px,
            progress=number / max(config.rounds - 1, 1), rng=planner.rng,
        )  # fmt: skip
        strokes = strokes.joined(new)
        optimise(
            strokes, canvas, scene, config, iterations=config.iterations_per_round,
            free_color=scene.tool.color_srgb is None, rate=1.0, log=planner.log,
            first_iteration=number * config.iterations_per_round, last_rate=_ROUND_END,
        )  # fmt: skip
        if config.min_gain_per_stroke is None:
            continue
        after = objective(render_plan(strokes, canvas, scene))[0]
        if before - after < config.min_gain_per_stroke * count:
            break
        before = after
    return strokes


def _in_stretches(planner: Planner[S], draft: Draft[S], iterations: int, *, rate: float, done: int) -> Draft[S]:
    """Descend in stretches of ``relocate_every`` iterations with a repair in between. The rate falls to 0.

    Args:
        rate: share of the learning rates at the start.
        done: iterations before the first of these, for ``log``.
    """
    if iterations == 0:
        return draft
    config, tool, coarse = planner.config, planner.scene.tool, planner.coarse()
    free = tool.color_srgb is None and (draft.paints is None or config.palette.source == "plan")
    places = config.objectives.print_weight > 0  # the other objectives do not say where a single stroke belongs
    every = config.relocate_every or max(iterations // 4, 1)
    starts = list(range(0, max(iterations - every // 2, 1), every))
    for start, end in zip(starts, [*starts[1:], iterations], strict=True):
        if 0 < start <= (1 - _SETTLE) * iterations and config.relocate_every > 0 and places:
            draft = _repaired(coarse, draft)
        first, last = (half_cosine(at, iterations, rate, 0.0) for at in (start, end))
        task = coarse if draft.paints is None and end <= _COARSE * iterations else planner
        optimise(
            draft.strokes, task.canvas, task.scene, task.config, iterations=end - start, free_color=free, rate=first,
            log=planner.log, first_iteration=done + start, last_rate=last, paints=draft.paints,
        )  # fmt: skip
    return draft


def _repaired(planner: Planner[S], draft: Draft[S]) -> Draft[S]:
    """Useless strokes relocated and, with paints, some strokes repainted and the order restored."""
    canvas, scene, config, paints = planner.canvas, planner.scene, planner.config, draft.paints
    colors = None if paints is None else paints.linear.astype(np.float64)
    strokes, _ = relocate(
        draft.strokes, canvas, scene, config=config, family=planner.family, paints=colors, rng=planner.rng
    )
    if paints is None:
        return Draft(strokes, None)
    index = np.square(strokes.color[:, None] - paints.linear).sum(-1).argmin(1)
    repainted, paints = repaint(strokes, replace(paints, index=index), canvas, scene, config=config)
    return Draft(*in_order(repainted, paints, scene, config))
