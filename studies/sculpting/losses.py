"""Losses over fifty actions at one relief, pushed with a ball or pinched with a gripper (thesis Figure 7.11).

`python -m studies.sculpting.losses --material dough --tool ball --rising-share 1 --models DIR --out FILE.json`
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.images import write_png
from pentimento.control.execute import Session
from pentimento.control.sculptor import sculpt, seen_m
from pentimento.goals3d.shading import photograph
from pentimento.goals3d.sources import relief_of
from pentimento.planning.objectives import ClayObjective
from pentimento.planning.pushes.goal import fit_goal
from studies.sculpting.clay import model_of, robot_with, settings

ACTIONS = 50
DEPTH_M = 0.004


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`, and next to it a picture of the goal and the result."""
    torch.set_num_threads(1)
    given = settings(Path("params.yaml"))
    sculpting = given.sculpting
    robot, end_effector = robot_with(arguments.material, arguments.tool, given.sculpt.scan_pixels, arguments.seed)
    scan = robot.scan()
    members = model_of(arguments.material, arguments.tool, given, arguments.models, scan.window_m)
    height, _ = seen_m(scan)
    soften_px = sculpting.edge_blur_m * height.shape[1] / robot.area_m[0]
    relief = relief_of("shape:cross", (height.shape[0], height.shape[1]), sculpting.side_share, soften_px=soften_px)
    fit = fit_goal(relief, height, replace(sculpting.fit, depth_m=DEPTH_M, rising_share=arguments.rising_share))
    # No early stop: both tools execute all fifty actions.
    execution, config = (
        replace(sculpting.execution, patience=ACTIONS),
        replace(sculpting.planner, min_relative_gain=0.0),
    )
    made = sculpt(
        robot, end_effector, arguments.material, goal_m=fit.height_m, members=members, grid=given.grid, config=config,
        execution=execution, count=ACTIONS, session=Session("losses", robot.clock_s), item=0, log=lambda *_: None,
    )  # fmt: skip
    objective = ClayObjective(fit.height_m, scan.window_m, config.weights)
    said = {
        "material": arguments.material,
        "tool": arguments.tool,
        "seed": arguments.seed,
        "error_3d_mm2": objective.error_3d_mm2(made.heights_m).tolist(),
        "visual_error": objective.visual_error(made.heights_m).tolist(),
        "prediction_error_mm2": float(np.square(1e3 * (made.heights_m[1:] - made.predicted_m)).mean()),
    }
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    pair = np.hstack([photograph(each, scan.window_m, 2) for each in (fit.height_m, made.heights_m[-1])])
    write_png(arguments.out.with_suffix(".png"), pair)
    atomic_write(arguments.out, (json.dumps(said, indent=1) + "\n").encode())
    print(
        arguments.tool,
        *(f"{name} {said[name][0]:.4f} -> {said[name][-1]:.4f}" for name in ("error_3d_mm2", "visual_error")),
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="losses", description=__doc__)
    parser.add_argument("--material", required=True)
    parser.add_argument("--tool", required=True)
    parser.add_argument("--rising-share", type=float, required=True)
    parser.add_argument("--models", required=True, type=Path, help="push models are kept here")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", required=True, type=Path)
    main(parser.parse_args())
