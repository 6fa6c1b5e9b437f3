"""Plans: strokes added coarse to fine, moved by gradients, relocated where they are idle, then painted in few paints.

The thesis's planner (4.3.5, Figure 4.5) is the case of random strokes in one round, no relocation and one sweep.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pentimento.planning.strokes.bezier import Strokes, no_strokes, with_color
from pentimento.planning.strokes.config import Log, PlannerConfig
from pentimento.planning.strokes.descent import half_cosine, optimise
from pentimento.planning.strokes.initialise import guided_strokes, random_strokes
from pentimento.planning.strokes.paints import (
    Paints,
    check_palette,
    choose_paints,
    in_order,
    repaint,
)
from pentimento.planning.strokes.relocate import relocate
from pentimento.planning.strokes.render_plan import render_plan
from pentimento.planning.strokes.scene import (
    Scene,
    coarser,
    first_pass,
    objective_for,
)

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

_ROUND_END = 0.3
"""Share of the learning rates that is left at a round's end: the next round goes on from there."""
_COARSE = 0.5
"""Of the iterations with free colours, the first, at half the resolution: strokes are still far from their places."""
_SETTLE = 0.15
"""Of the iterations, the last, in which no stroke is relocated and no paint exchanged: they finish what is there."""
_PAINT_RATE = 0.5
"""Share of the learning rates with which strokes adapt to paints."""


@dataclass(frozen=True)
class Draft:
    """A plan in the making."""

    strokes: Strokes
    paints: Paints | None
    """None while colours are free, and for a tool with its own ink."""


def plan(canvas: Array, scene: Scene, count: int, config: PlannerConfig, log: Log) -> tuple[Strokes, FloatArray]:
    """Up to ``count`` strokes in the order of execution, and their palette, sRGB [K, 3] from light to dark.

    ``log("objective", value, iteration)`` is called at every iteration.

    Raises:
        ConfigError: the palette does not fit the tool, or the picture is smaller than a viewing distance.
        ImageError: there is no such picture as the palette's.
    """
    check_palette(config.palette, scene.tool)
    rng = np.random.default_rng([config.seed, 0])
    strokes = free_plan(canvas, scene, count, config, rng, log)
    if scene.tool.color_srgb is not None:
        return strokes, np.array([scene.tool.color_srgb])
    paints = choose_paints(strokes, config.palette, config.seed)
    draft = Draft(*in_order(paints.dipped(strokes), paints, scene, config))
    done = config.rounds * config.iterations_per_round + config.iterations_free
    draft = _in_stretches(draft, config.iterations_palette, _PAINT_RATE, canvas, scene, config, rng, log, done)
    assert draft.paints is not None
    strokes, paints = in_order(draft.strokes, draft.paints, scene, config)
    return strokes, paints.srgb()


def free_plan(
    canvas: Array, scene: Scene, count: int, config: PlannerConfig, rng: np.random.Generator, log: Log
) -> Strokes:
    """Up to ``count`` strokes, each in a colour of its own, in the order in which they were laid: coarse below fine."""
    first_scene, first_config = first_pass(scene, config)
    strokes = _in_rounds(canvas, first_scene, count, first_config, rng, log)
    done = config.rounds * config.iterations_per_round
    draft = Draft(strokes, None)
    return _in_stretches(draft, config.iterations_free, 1.0, canvas, scene, config, rng, log, done).strokes


def _in_rounds(
    canvas: Array, scene: Scene, count: int, config: PlannerConfig, rng: np.random.Generator, log: Log
) -> Strokes:
    """Strokes added round by round, coarse to fine, at half the resolution."""
    small, small_canvas, small_config = coarser(scene, canvas, config)
    strokes = no_strokes()
    objective = objective_for(small, small_config)

    def loss() -> float:
        return objective(render_plan(strokes, small_canvas, small))[0]

    first, last = config.sizes
    before = loss()
    for number, share in enumerate(round_shares(count, config.rounds)):
        if share == 0:
            continue
        size = last + (first - last) * (1 - number / max(config.rounds - 1, 1)) ** 2
        strokes = strokes.joined(_new_strokes(share, size, strokes, small_canvas, small, small_config, rng))
        optimise(
            strokes, small_canvas, small, small_config, config.iterations_per_round, scene.tool.color_srgb is None,
            1.0, log, number * config.iterations_per_round, _ROUND_END,
        )  # fmt: skip
        after = loss()
        if before - after < config.min_gain * share:
            break
        before = after
    return strokes


def round_shares(count: int, rounds: int) -> list[int]:
    """``count`` strokes over the rounds, the last of which gets twice as many as the first: the finer, the more."""
    weights = np.linspace(1, 2, rounds) if rounds > 1 else np.ones(1)
    ends = np.rint(count * np.cumsum(weights) / weights.sum()).astype(int)
    return [int(share) for share in np.diff(ends, prepend=0)]


def _new_strokes(
    count: int,
    size: float,
    present: Strokes,
    canvas: Array,
    scene: Scene,
    config: PlannerConfig,
    rng: np.random.Generator,
) -> Strokes:
    if config.initialisation == "random":
        new = random_strokes(count, scene.tool, scene.canvas_size_m, rng)
        if scene.tool.color_srgb is not None:
            new = with_color(new, np.tile(np.array(scene.tool.color_srgb, np.float32), (count, 1)))
        new.keep_within(scene.tool, scene.canvas_size_m, config.edge_m)
        return new
    image = render_plan(present, canvas, scene)
    return guided_strokes(count, size, image, scene, config, None, rng)[0]


def _in_stretches(
    draft: Draft,
    iterations: int,
    rate: float,
    canvas: Array,
    scene: Scene,
    config: PlannerConfig,
    rng: np.random.Generator,
    log: Log,
    done: int,
) -> Draft:
    """Descend by ``iterations`` in stretches of ``config.relocate_every``, mending in between; the rate falls to 0."""
    if iterations == 0:
        return draft
    free = scene.tool.color_srgb is None and (draft.paints is None or config.palette.source == "plan")
    small, small_canvas, small_config = coarser(scene, canvas, config)
    likeness = config.objectives.print_weight > 0  # else nothing says where strokes should go
    every = config.relocate_every or max(iterations // 4, 1)
    starts = list(range(0, max(iterations - every // 2, 1), every))
    for start, end in zip(starts, [*starts[1:], iterations], strict=True):
        if 0 < start <= (1 - _SETTLE) * iterations and config.relocate_every > 0 and likeness:
            draft = _mended(draft, small_canvas, small, small_config, rng)
        first, last = (half_cosine(at, iterations, rate, 0.0) for at in (start, end))
        coarse = draft.paints is None and end <= _COARSE * iterations
        task = (small_canvas, small, small_config) if coarse else (canvas, scene, config)
        optimise(draft.strokes, *task, end - start, free, first, log, done + start, last, draft.paints)
    return draft


def _mended(draft: Draft, canvas: Array, scene: Scene, config: PlannerConfig, rng: np.random.Generator) -> Draft:
    """Idle strokes relocated and, with paints, some exchanged and the order restored."""
    paints = draft.paints
    colors = None if paints is None else paints.linear.astype(np.float64)
    strokes = relocate(draft.strokes, canvas, scene, config, colors, rng)[0]
    if paints is None:
        return Draft(strokes, None)
    index = np.square(strokes.color[:, None] - paints.linear).sum(-1).argmin(1)
    strokes, paints = repaint(strokes, Paints(paints.linear, index), canvas, scene, config)
    return Draft(*in_order(strokes, paints, scene, config))
