"""What a whole plan takes: 400 strokes, 400 iterations, 315 x 210 px (as many as 256²), wall time of one thread."""

import time
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import torch

from benchmarks.plain_adam import OURS, SIZE_M, STROKES, plain_adam, scene_of
from pentimento.planning.strokes.initialise import random_strokes
from pentimento.planning.strokes.planner import plan

Way = Literal["thesis", "ours"]
WAYS: tuple[Way, ...] = ("thesis", "ours")
ITERATIONS = 400
_PICTURE, _SEED = "chelsea", 1


def measure_plan(way: Way) -> dict[str, Any]:
    """Seconds of one plan, everything included; a short one is made before, to compile.

    thesis: random strokes, free colours, nothing but descent. ours: half of the iterations with free colours and half
    with 12 paints, all at full resolution; what the first rounds do at half the resolution comes on top.
    """
    torch.set_num_threads(1)
    _plan(way, STROKES // 10, ITERATIONS // 20)
    started = time.perf_counter()
    iterations, loss = _plan(way, STROKES, ITERATIONS)
    return {"way": way, "s": time.perf_counter() - started, "iterations": iterations, "min_loss": loss}


def _plan(way: Way, strokes: int, iterations: int) -> tuple[int, float]:
    """Make one; how often the objective was asked for, and its least value."""
    scene, canvas = scene_of(_PICTURE)
    losses: list[float] = []

    def log(_name: str, value: float, _step: int) -> None:
        losses.append(value)

    match way:
        case "thesis":
            random = random_strokes(strokes, scene.tool, SIZE_M, np.random.default_rng(_SEED))
            random.keep_within(scene.tool, SIZE_M, OURS.edge_m)
            plain_adam(random, canvas, scene, multiple=4.0, free_color=True, log=log)
        case "ours":
            config = replace(OURS, iterations_free=iterations // 2, iterations_palette=iterations // 2)
            plan(canvas, scene, strokes, config, log)
    return len(losses), min(losses)
