"""The planner beside plain Adam from random starts (thesis 4.3.5): time, loss, and what the studio makes of the plans.

Both lower the same objective with the same renderer and stroke model, on a canvas of 315 x 210 px (as many as 256²).
The baseline is the thesis's way: as many strokes, uniform over all their parameters, PyTorch's Adam for 400 iterations.
It gets the best of several multiples of our first learning rates, chosen for each picture afterwards, and a cosine
schedule: of multiples 1, 2 and 4 on three pictures, the best with it ended lower than the best without.

Where plans are executed, ours plans for ``ExecutionNoise``. A third plan tells which part of the difference that makes:
the baseline's with its best learning rate, told the same at every iteration.

Seconds are CPU seconds of one thread: wall time where nothing else runs.
"""

import json
import statistics
import sys
import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numba
import numpy as np
import skimage
import torch
from numpy.typing import NDArray

from benchmarks.plain_adam import (
    OURS,
    STROKES,
    Clock,
    Curve,
    anywhere,
    best_adam,
    constant_adam,
    plain_adam,
    scene_of,
)
from pentimento.control.painter import as_linear, paint
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.config import ExecutionNoise
from pentimento.planning.strokes.paints import choose_paints, in_order
from pentimento.planning.strokes.planner import free_plan, plan
from pentimento.planning.strokes.render_plan import render_plan
from pentimento.planning.strokes.scene import Scene, objective_for
from pentimento.planning.strokes.target import PHOTOGRAPHS
from pentimento.robots.virtual import VirtualRobot
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import load_world

FloatArray = NDArray[np.float64]
Light = NDArray[np.float32]

DATA = Path(skimage.__file__).parent / "data"
PICTURES = (*PHOTOGRAPHS, *(str(DATA / name) for name in ("hubble_deep_field.jpg", "motorcycle_left.png", "ihc.png")))
SEEDS = (1, 2)
SCHEDULES = {"short": (40, 4), "middle": (120, 5), "long": (390, 10)}
"""Iterations with free colours, and between two relocations. The last takes about as long as the baseline and is what
is compared at equal time, cut off there; to the baseline's loss goes the first that gets there."""
EXECUTION_NOISE = ExecutionNoise(0.3, 0.0)
"""Where plans are executed."""


def measure(picture: str, seed: int, execute: bool) -> dict[str, Any]:
    """One picture: both planners with free colours, in 12 paints, and, if wanted, both paintings in the studio."""
    scene, canvas = scene_of(picture)
    best = best_adam(canvas, scene, seed)
    adam = best.curve
    row: dict[str, Any] = {"picture": Path(picture).stem, "seed": seed, "strokes": STROKES}
    row["adam"] = {
        "multiple": best.multiple,
        "seconds": adam.seconds[-1],
        "loss": adam.loss[-1],
        "minimum": min(adam.loss),
    }
    constant = constant_adam(canvas, scene, seed)
    row["constant"] = {"seconds": constant.seconds[-1], "loss": constant.loss[-1]}
    for name, (iterations, every) in SCHEDULES.items():
        config = replace(OURS, iterations_free=iterations, relocate_every=every, seed=seed)
        clock = Clock(config.rounds * config.iterations_per_round + iterations // 2)
        rng = np.random.default_rng([seed, 0])
        free_plan(canvas, scene, STROKES, config, rng=rng, log=clock)
        row[name] = {
            "reaches_seconds": clock.curve.reaches(adam.loss[-1]),
            "reaches_constant_seconds": clock.curve.reaches(constant.loss[-1]),
            "seconds": clock.curve.seconds[-1],
            "loss": min(clock.curve.loss),
        }
    row["long"]["loss_at_equal_time"] = clock.curve.after(adam.seconds[-1])
    row["long"]["loss_at_constant_time"] = clock.curve.after(constant.seconds[-1])
    row["reaches_seconds"], row["speedup"] = _first_to_reach(row, "reaches_seconds", adam)
    row["lower_by"] = 1 - row["long"]["loss_at_equal_time"] / adam.loss[-1]
    row["reaches_constant_seconds"], row["constant_speedup"] = _first_to_reach(
        row, "reaches_constant_seconds", constant
    )
    row["constant_lower_by"] = 1 - row["long"]["loss_at_constant_time"] / constant.loss[-1]
    row["paints"] = _in_paints(best.strokes, canvas, scene, multiple=best.multiple, seed=seed, execute=execute)
    return row


def _first_to_reach(row: dict[str, Any], which: str, baseline: Curve) -> tuple[float | None, float]:
    """Seconds of the shortest schedule that reaches the baseline's loss, and how many times as long that took."""
    reached = next((row[name][which] for name in SCHEDULES if row[name][which] is not None), None)
    return reached, 0.0 if reached is None else baseline.seconds[-1] / reached


def _in_paints(
    theirs: Strokes, canvas: Light, scene: Scene, *, multiple: float, seed: int, execute: bool
) -> dict[str, Any]:
    """All plans in 12 paints: the baselines ordered from light to dark and given as many iterations again."""
    objective = objective_for(scene, OURS)
    plans = {}
    start = time.process_time()
    plans["adam"] = (
        *_light_to_dark(theirs, canvas, scene, multiple=multiple, seed=seed, execution_noise=OURS.execution_noise),
        time.process_time() - start,
    )
    if execute:
        told = anywhere(scene, seed)
        plain_adam(
            told, canvas, scene, multiple=multiple, free_color=True, log=Clock(0), execution_noise=EXECUTION_NOISE
        )
        start = time.process_time()
        plans["adam_told"] = (
            *_light_to_dark(told, canvas, scene, multiple=multiple, seed=seed, execution_noise=EXECUTION_NOISE),
            time.process_time() - start,
        )
    start = time.process_time()
    config = replace(OURS, iterations_free=120, execution_noise=EXECUTION_NOISE, seed=seed)
    plans["ours"] = (*plan(canvas, scene, STROKES, config, _unheard), time.process_time() - start)
    result: dict[str, Any] = {}
    for name, (strokes, colors, seconds) in plans.items():
        loss = objective(render_plan(strokes, canvas, scene))[0]
        changes = int((strokes.color[1:] != strokes.color[:-1]).any(1).sum())
        result[name] = {"loss": loss, "paint_changes": changes, "seconds": seconds}
        if execute:
            robot = VirtualRobot(Studio(load_world("round_brush"), seed))
            painting = paint(
                robot,
                scene,
                strokes,
                palette_srgb=colors,
                replan_every=STROKES,
                replan=False,
                config=OURS,
                log=_unheard,
            )
            executed = objective(as_linear(painting.photos[-1]))[0]
            result[name] |= {"executed": executed, "gap": executed - loss}
    return result


def _light_to_dark(
    strokes: Strokes, canvas: Light, scene: Scene, *, multiple: float, seed: int, execution_noise: ExecutionNoise
) -> tuple[Strokes, FloatArray]:
    """A baseline's plan in 12 paints, and these, sRGB [K, 3]."""
    paints = choose_paints(strokes, scene, OURS.palette, seed)
    strokes, paints = in_order(paints.dipped(strokes), paints, scene, replace(OURS, sweeps=1))
    plain_adam(
        strokes, canvas, scene, multiple=multiple, free_color=False, log=Clock(0), execution_noise=execution_noise
    )
    return strokes, paints.srgb()


def summary(rows: list[dict[str, Any]]) -> dict[str, float]:
    """What the bars are about: medians over pictures and seeds."""
    painted = [row["paints"] for row in rows if "executed" in row["paints"]["ours"]]

    def median(values: Iterable[float]) -> float:
        return float(statistics.median(values))

    return {
        "pictures": float(len({row["picture"] for row in rows})),
        "speedup": median(row["speedup"] for row in rows),
        "lower_by": median(row["lower_by"] for row in rows),
        "constant_speedup": median(row["constant_speedup"] for row in rows),
        "constant_lower_by": median(row["constant_lower_by"] for row in rows),
        "in_paints_lower_by": median(1 - r["paints"]["ours"]["loss"] / r["paints"]["adam"]["loss"] for r in rows),
        "executed_lower_by": median(1 - p["ours"]["executed"] / p["adam"]["executed"] for p in painted),
        "executed_lower_than_noise_aware_adam_by": median(
            1 - p["ours"]["executed"] / p["adam_told"]["executed"] for p in painted
        ),
        "better_paintings": sum(p["ours"]["executed"] < p["adam"]["executed"] for p in painted) / len(painted),
    }


def table(rows: list[dict[str, Any]]) -> str:
    """The rows in Markdown."""
    lines = [
        "| picture, seed | Adam: loss, s | ours reaches it: s, times faster | loss at Adam's time, lower by | "
        "constant rates: loss, s | ours reaches it: s, times faster | 12 paints: Adam, ours (paint changes) | "
        "executed: Adam, told, ours | gap: Adam, told, ours |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        adam, constant, painted = row["adam"], row["constant"], row["paints"]
        a, o = painted["adam"], painted["ours"]
        executed = " | ".join(
            ", ".join(f"{painted[who][what]:.4f}" for who in ("adam", "adam_told", "ours")) if what in a else "–"
            for what in ("executed", "gap")
        )
        lines.append(
            f"| {row['picture']}, {row['seed']} | {adam['loss']:.5f}, {adam['seconds']:.1f} "
            f"| {row['reaches_seconds'] or float('nan'):.2f}, {row['speedup']:.1f} "
            f"| {row['long']['loss_at_equal_time']:.5f}, {100 * row['lower_by']:.0f} % "
            f"| {constant['loss']:.5f}, {constant['seconds']:.1f} "
            f"| {row['reaches_constant_seconds'] or float('nan'):.2f}, {row['constant_speedup']:.1f} "
            f"| {a['loss']:.4f} ({a['paint_changes']}), {o['loss']:.4f} ({o['paint_changes']}) | {executed} |"
        )
    return "\n".join(lines)


def measure_all(pictures: tuple[str, ...] = PICTURES, seeds: tuple[int, ...] = SEEDS) -> list[dict[str, Any]]:
    """A row for each picture and seed; paintings are executed for the first seed. About a minute a row."""
    torch.set_num_threads(1)
    numba.set_num_threads(1)
    warm, rng = replace(OURS, iterations_free=20), np.random.default_rng(0)
    free_plan(*scene_of(PICTURES[0])[::-1], 20, warm, rng=rng, log=_unheard)
    rows = []
    for seed in seeds:
        for picture in pictures:
            rows.append(measure(picture, seed, seed == seeds[0]))
            print(table(rows[-1:]).splitlines()[-1], file=sys.stderr, flush=True)
    return rows


def main() -> None:
    """Print the table and the medians; write the rows to the file that is named."""
    rows = measure_all()
    print(table(rows))
    print(json.dumps(summary(rows), indent=1))
    if len(sys.argv) > 1:
        Path(sys.argv[1]).write_text(json.dumps({"rows": rows, "summary": summary(rows)}, indent=1) + "\n")


def _unheard(_name: str, _value: float, _step: int) -> None:
    """Curves that nobody asked for."""


if __name__ == "__main__":
    main()
