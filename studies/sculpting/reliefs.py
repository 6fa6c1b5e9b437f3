"""A letter, a face and a knot of 150 pushes, scanned at 512 × 512 and planned at 128 × 128 (thesis 7.2, A.2).

`python -m studies.sculpting.reliefs --goal face --models DIR --out FILE.json [--seed 1]`

The file is written after every plan, so that a run that was stopped leaves what it has done.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.images import write_png
from pentimento.control.execute import Session
from pentimento.control.loop import Hooks
from pentimento.control.sculptor import SculptureProgress, seen_m
from pentimento.goals3d.reliefs import letter_relief, place, soften
from pentimento.goals3d.shading import photograph
from pentimento.planning.objectives import ClayObjective, Weights
from pentimento.planning.pushes.goal import fit_goal
from pentimento.planning.pushes.scales import resampled
from studies.sculpting.clay import Clock, TimedSculptor, model_of, robot_with, settings
from studies.sculpting.shapes import face, knot

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

MATERIAL, TOOL = "foam", "ball"
SIDE_PX = 512
ACTIONS = 150
DEPTH_M = 0.009
SIDE_SHARE = 0.8
RISING_SHARE = 0.05
"""Foam absorbs nearly all; with more, the goal would have a plate that rises above the border."""
VISUAL = 4.0
"""Weight of the squared slope error; of the other weights see params.yaml."""
_RELIEF_PX = 256
_SHOWN_PX = 256


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`, and next to it a picture of the clay before, the goal and the result."""
    torch.set_num_threads(1)
    given = settings(Path("params.yaml"))
    sculpting = given.sculpting
    robot, end_effector = robot_with(MATERIAL, TOOL, arguments.side, arguments.seed)
    scan = robot.scan()
    members = model_of(MATERIAL, TOOL, given, arguments.models, scan.window_m)
    height, _ = seen_m(scan)
    relief = {"face": face, "knot": knot}.get(arguments.goal, lambda side: letter_relief(arguments.goal, side))
    soften_px = sculpting.edge_blur_m * arguments.side / robot.area_m[0]
    placed = soften(place(relief(_RELIEF_PX), (height.shape[0], height.shape[1]), SIDE_SHARE), soften_px)
    fit = fit_goal(placed, height, replace(sculpting.fit, depth_m=DEPTH_M, rising_share=RISING_SHARE))
    weights = replace(sculpting.planner.weights, visual=VISUAL)
    sculptor = TimedSculptor(
        robot=robot, end_effector=end_effector, material=MATERIAL, goal_m=fit.height_m, members=members,
        grid=given.grid, config=replace(sculpting.planner, weights=weights), execution=sculpting.execution,
        count=arguments.actions, session=Session("reliefs", robot.clock_s), item=0, record=lambda _: None,
        clock=Clock(),
    )  # fmt: skip
    window_m = scan.window_m
    noise = _noise_of_a_scan(height, seen_m(robot.scan())[0], window_m, weights)
    begun = sculptor.begin()[0]

    def keep(state: SculptureProgress) -> None:
        print(len(state.actions), f"{state.values[-1]:.4f}", f"{sculptor.clock.cpu_s:.1f} s", flush=True)
        if state.due == 0 or len(state.actions) == arguments.actions:
            _write(arguments, sculptor, state, window_m, noise)

    final, stopped = sculptor.run(begun, Hooks[SculptureProgress](on_action=keep))
    _write(arguments, sculptor, final, window_m, noise)
    print(stopped)


def _noise_of_a_scan(first_m: Array, second_m: Array, window_m: FloatArray, weights: Weights) -> dict[str, float]:
    """The errors that noise of one scan makes on average: half those between two scans [H, W] of the same surface."""
    between = ClayObjective(first_m, window_m, weights)
    return {
        "error_3d_mm2": float(between.error_3d_mm2(second_m)) / 2,
        "visual_error": float(between.visual_error(second_m)) / 2,
    }


def _write(
    arguments: argparse.Namespace,
    sculptor: TimedSculptor,
    state: SculptureProgress,
    window_m: FloatArray,
    noise: dict[str, float],
) -> None:
    fine = sculptor.foresight.objective
    maps = (state.heights_m[0], sculptor.goal_m, state.heights_m[-1])
    grid = tuple(resampled(each, sculptor.grid) for each in maps)
    coarse = ClayObjective(grid[1], window_m, fine.weights)
    off = [float(np.square(1e3 * (a - b)).mean()) for a, b in zip(state.heights_m[1:], state.expected_m, strict=True)]
    found: dict[str, Any] = {
        "goal": arguments.goal, "seed": arguments.seed, "side_px": arguments.side, "grid": sculptor.grid,
        "actions": np.array(state.actions).tolist(),
        "error_3d_mm2": [float(fine.error_3d_mm2(each)) for each in (maps[0], maps[2])],
        "visual_error": [float(fine.visual_error(each)) for each in (maps[0], maps[2])],
        "visual_error_on_grid": [float(coarse.visual_error(each)) for each in (grid[0], grid[2])],
        "values": list(state.values),
        "prediction_error_mm2": float(np.mean(off)),
        "noise_of_a_scan": noise,
        "plans": vars(sculptor.clock),
    }  # fmt: skip
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    scale = max(_SHOWN_PX // arguments.side, 1)
    write_png(arguments.out.with_suffix(".png"), np.hstack([photograph(each, window_m, scale) for each in maps]))
    atomic_write(arguments.out, (json.dumps(found, indent=1) + "\n").encode())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="reliefs", description=__doc__)
    parser.add_argument("--goal", required=True, help="face, knot, or a letter")
    parser.add_argument("--models", required=True, type=Path, help="push models are kept here")
    parser.add_argument("--actions", type=int, default=ACTIONS)
    parser.add_argument("--side", type=int, default=SIDE_PX, help="of a scan, px")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", required=True, type=Path)
    main(parser.parse_args())
