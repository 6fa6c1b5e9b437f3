"""Gradient descent through the stroke renderer (thesis 4.3.5, Figure 4.5)."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from pentimento.planning.adam import Adam
from pentimento.planning.objectives import Objective
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.config import Log, PlannerConfig
from pentimento.planning.strokes.paints import Paints
from pentimento.planning.strokes.render_plan import (
    Fault,
    expected_fault,
    faults,
    render_and_back,
    render_plan,
)
from pentimento.planning.strokes.scene import Scene, inherit, objective_for

Array = NDArray[np.float32]


def optimise(
    strokes: Strokes,
    canvas: Array,
    scene: Scene,
    config: PlannerConfig,
    iterations: int,
    free_color: bool,
    rate: float,
    log: Log,
    first_iteration: int,
    last_rate: float = 0.0,
    paints: Paints | None = None,
) -> None:
    """Move the strokes, in place, down the planner's objective, always within what tool and canvas allow.

    They end where the objective was least on the way, so never worse than they started. Where the plan leaves room for
    mishaps, each iteration sees others, and start and end are compared under the expected ones. See ``descend`` for the
    rest. ``log("objective", value, iteration)`` is called at every iteration.
    """
    objective, execution_noise = objective_for(scene, config), config.execution_noise
    expected = expected_fault(len(strokes), execution_noise) if execution_noise.any() else None
    rng = np.random.default_rng([config.seed, 2, first_iteration])

    def fault(iteration: int) -> Fault | None:
        return faults(len(strokes), execution_noise, rng) if execution_noise.any() and iteration > 0 else expected

    minimum, best, kept_paints = np.inf, strokes.pick(slice(None)), None if paints is None else paints.linear.copy()
    way = descend(
        strokes, canvas, scene, config, objective, iterations, free_color, rate, last_rate, paints, fault
    )  # fmt: skip
    for iteration, value in enumerate(way):
        if value < minimum and (iteration == 0 or not execution_noise.any()):
            minimum, best = value, strokes.pick(slice(None))
            kept_paints = None if paints is None else paints.linear.copy()
        log("objective", value, first_iteration + iteration)
    if objective(render_plan(strokes, canvas, scene, expected))[0] < minimum:
        return
    for array, kept in zip(strokes.arrays(), best.arrays(), strict=True):
        array[:] = kept
    if paints is not None and kept_paints is not None:
        paints.linear[:] = kept_paints


def descend(
    strokes: Strokes,
    canvas: Array,
    scene: Scene,
    config: PlannerConfig,
    objective: Objective,
    iterations: int,
    free_color: bool,
    rate: float,
    last_rate: float = 0.0,
    paints: Paints | None = None,
    fault: Callable[[int], Fault | None] = lambda _: None,
) -> Iterator[float]:
    """Move the strokes, in place, down an objective, always within what tool and canvas allow.

    Each iteration's objective is yielded, and the strokes are moved when the next is asked for; after the last they
    stand where it left them. What they inherit is held as it is at the start.

    Args:
        canvas: [H, W, 3], linear light: what they are laid upon.
        rate: share of the learning rates; it falls to ``last_rate`` along half a cosine.
        paints: it is they whose colours are free: strokes of one paint share one colour.
        mishap: what befalls the strokes in an iteration.
    """
    rates = config.learning_rates
    own = [rates.middle_m, rates.theta_rad, rates.length_m, rates.bend_m, rates.press_m, rates.color]
    moved = list(strokes.arrays()) if paints is None else [*strokes.arrays()[:-1], paints.linear]
    if not free_color:
        own, moved = own[:-1], moved[:-1]
    adam = Adam(moved)
    strokes.inherited = inherit(strokes, scene)
    for iteration in range(iterations):
        if paints is not None:
            strokes.color[:] = paints.linear[paints.index]
        image, back = render_and_back(strokes, canvas, scene, fault(iteration))
        value, of_image = objective(image)
        yield value
        gradients = list(back(of_image).arrays())
        if paints is not None:
            of_paints = np.zeros_like(paints.linear)
            np.add.at(of_paints, paints.index, gradients[-1])
            gradients[-1] = of_paints
        share = half_cosine(iteration, iterations, rate, last_rate)
        adam.step(gradients[: len(moved)], [share * step for step in own])
        if paints is not None:
            np.clip(paints.linear, 0.0, 1.0, out=paints.linear)
            strokes.color[:] = paints.linear[paints.index]
        strokes.keep_within(scene.tool, scene.canvas_size_m, config.edge_m)


def half_cosine(iteration: int, iterations: int, first: float, last: float) -> float:
    """From ``first`` at iteration 0 to ``last`` at ``iterations``, level at both ends."""
    return float(last + (first - last) * 0.5 * (1 + np.cos(np.pi * iteration / iterations)))
