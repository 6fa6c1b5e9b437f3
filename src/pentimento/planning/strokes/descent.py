"""Gradient descent through the stroke renderer (thesis 4.3.5, Figure 4.5)."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from pentimento.planning.adam import Adam, half_cosine
from pentimento.planning.objectives import Objective
from pentimento.planning.strokes.config import Log, PlanConfig
from pentimento.planning.strokes.paints import DARKEST, Paints
from pentimento.planning.strokes.paths import PlannedPaths
from pentimento.planning.strokes.render_plan import Fault, expected_fault, faults, render_and_back, render_plan
from pentimento.planning.strokes.scene import Scene, inherit, objective_for

Array = NDArray[np.float32]


def optimise(
    strokes: PlannedPaths, canvas: Array, scene: Scene, config: PlanConfig, *, iterations: int, free_color: bool,
    rate: float, log: Log, first_iteration: int = 0, last_rate: float = 0.0, paints: Paints | None = None,
) -> None:  # fmt: skip
    """Move the strokes, in place, down the planner's objective, within what tool and canvas allow; see ``descend``.

    With ``config.keep_best`` they end at the lowest objective on the way, so never worse than they started. With
    execution noise each iteration draws other faults, and only start and end are compared, under the expected fault.
    With objectives of meaning, whose values do not compare, they end after the last iteration.
    ``log("objective", value, iteration)`` is called at every iteration.
    """
    objective, execution_noise = objective_for(scene, config), config.execution_noise
    expected = expected_fault(len(strokes), execution_noise) if execution_noise.any() else None
    rng = np.random.default_rng([config.seed, 2, first_iteration])

    def fault(iteration: int) -> Fault | None:
        return faults(len(strokes), execution_noise, rng) if execution_noise.any() and iteration > 0 else expected

    minimum, best = np.inf, _copied(strokes, paints)
    values = descend(
        strokes, canvas, scene, config, objective=objective, iterations=iterations, free_color=free_color, rate=rate,
        last_rate=last_rate, paints=paints, fault=fault,
    )  # fmt: skip
    for iteration, value in enumerate(values):
        if value < minimum and (iteration == 0 or not execution_noise.any()):
            minimum, best = value, _copied(strokes, paints)
        log("objective", value, first_iteration + iteration)
    if not config.keep_best or config.objectives.has_meaning:
        return
    if objective(render_plan(strokes, canvas, scene, expected))[0] < minimum:
        return
    for array, kept in zip(_moved(strokes, paints), best, strict=True):
        array[:] = kept


def descend(
    strokes: PlannedPaths, canvas: Array, scene: Scene, config: PlanConfig, *, objective: Objective, iterations: int,
    free_color: bool, rate: float, last_rate: float = 0.0, paints: Paints | None = None,
    fault: Callable[[int], Fault | None] = lambda _: None,
) -> Iterator[float]:  # fmt: skip
    """Move the strokes, in place, down an objective, within what tool and canvas allow.

    The objective of each iteration is yielded. The strokes move when the next one is asked for; after the last they
    stay where it left them.

    Args:
        canvas: [H, W, 3], linear light, under the strokes.
        free_color: whether colours move, too.
        rate: share of the learning rates at the start. It falls to ``last_rate`` along half a cosine.
        paints: where given, it is their colours that move, and strokes of one paint share its colour.
        fault: the execution errors in an iteration.
    """
    rates, moved, scales = list(config.learning_rates.steps()), list(strokes.arrays()), list(strokes.scales())
    if paints is not None:
        moved[-1] = paints.linear
    if not free_color:
        rates, moved, scales = rates[:-1], moved[:-1], scales[:-1]
    adam = Adam(moved, scales)
    if strokes.holds_covariates:
        strokes.inherited = inherit(strokes, scene)
    for iteration in range(iterations):
        if paints is not None:
            strokes.color[:] = paints.linear[paints.index]
        image, back = render_and_back(strokes, canvas, scene, fault(iteration))
        value, of_image = objective(image)
        yield value
        gradients = list(back(of_image))
        if paints is not None:
            of_paints = np.zeros_like(paints.linear)
            np.add.at(of_paints, paints.index, gradients[-1])
            of_paints[paints.fixed] = 0.0
            gradients[-1] = of_paints
        share = half_cosine(iteration, iterations, rate, last_rate)
        adam.step(gradients[: len(moved)], [share * step for step in rates])
        if paints is not None:
            if free_color:  # paints that were given stay as they are
                np.clip(paints.linear, DARKEST, 1.0, out=paints.linear)
            strokes.color[:] = paints.linear[paints.index]
        strokes.keep_within(scene.tool, scene.canvas_size_m, config.edge_m)


def _moved(strokes: PlannedPaths, paints: Paints | None) -> tuple[Array, ...]:
    return strokes.arrays() if paints is None else (*strokes.arrays(), paints.linear)


def _copied(strokes: PlannedPaths, paints: Paints | None) -> tuple[Array, ...]:
    return tuple(array.copy() for array in _moved(strokes, paints))
