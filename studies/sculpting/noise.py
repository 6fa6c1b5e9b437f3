"""The execution noise above which a plan is worse than no action, in height and in slope (thesis Figure 7.14).

All in the learned model: a plan is executed with noise on its actions, and the errors of the results are averaged over
draws. `python -m studies.sculpting.noise --material foam --models DIR --out FILE.json [--seed 0]`
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
from pentimento.control.sculptor import reach_for, seen_m
from pentimento.goals3d.sources import relief_of
from pentimento.planning.objectives import ClayObjective
from pentimento.planning.pushes.config import Reach, SculptorConfig
from pentimento.planning.pushes.goal import fit_goal
from pentimento.planning.pushes.plan import plan
from pentimento.planning.pushes.rollout import EnsembleRollout
from studies.sculpting.clay import model_of, robot_with, settings

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

ACTIONS, DRAWS, BATCH = 40, 6, 4
VISUAL = 10.0
"""Weight of the slopes in the plan, at which both errors fall."""
LEVELS = (0.0, 0.1, 0.2, 0.3, 0.5, 0.75, 1.0, 1.5, 2.0)
AT_ONE = np.array([0.008, 0.008, 0.5, 0.008, 0.003])
"""Standard deviations of place, heading, length and depth at level 1."""


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: for each level the noise in mm², and both errors relative to those without any action."""
    torch.set_num_threads(1)
    given = settings(Path("params.yaml"))
    sculpting = given.sculpting
    setting = given.sculpt.settings["foam"]
    robot, end_effector = robot_with(arguments.material, setting.end_effector, given.sculpt.scan_pixels, arguments.seed)
    scan = robot.scan()
    members = model_of(arguments.material, setting.end_effector, given, arguments.models, scan.window_m)
    height, _ = seen_m(scan)
    soften_px = sculpting.edge_blur_m * height.shape[1] / robot.area_m[0]
    relief = relief_of("shape:cross", (height.shape[0], height.shape[1]), sculpting.side_share, soften_px=soften_px)
    fit = fit_goal(relief, height, sculpting.fit)
    objective = ClayObjective(fit.height_m, scan.window_m, replace(sculpting.planner.weights, visual=VISUAL))
    foresight = EnsembleRollout(members, objective, sculpting.planner.disagreement_weight)
    reach = reach_for(end_effector, robot.area_m, sculpting.planner.edge_m)
    actions = _planned(height, foresight, reach, sculpting.planner)
    nothing = {
        "error_3d_mm2": float(objective.error_3d_mm2(height)),
        "visual_error": float(objective.visual_error(height)),
    }
    side_px = given.training.side_px
    levels: list[dict[str, Any]] = []
    for number, level in enumerate(LEVELS):
        drawn = []
        for draw in range(DRAWS if level else 1):
            rng = np.random.default_rng([arguments.seed, number, draw])
            shaken = reach.keep_within(actions + level * AT_ONE * rng.normal(size=actions.shape))
            after = foresight.roll_out(height, shaken).mean(axis=0)
            each = foresight.members[0].after(height, actions) - foresight.members[0].after(height, shaken)
            off = float(np.square(1e3 * each).sum(axis=(1, 2)).mean()) / side_px**2
            drawn.append([off, float(objective.error_3d_mm2(after)), float(objective.visual_error(after))])
        means = np.mean(drawn, axis=0)
        levels.append({"level": level, "noise_mm2": means[0], "error_3d_mm2": means[1], "visual_error": means[2]})
        print(f"{level}: noise {means[0]:.3f} mm2, height {means[1] / nothing['error_3d_mm2']:.2f}, slope "
              f"{means[2] / nothing['visual_error']:.2f} of doing nothing")  # fmt: skip
    said = {
        "material": arguments.material,
        "actions": len(actions),
        "draws": DRAWS,
        "nothing": nothing,
        "levels": levels,
    }
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    atomic_write(arguments.out, (json.dumps(said, indent=1) + "\n").encode())


def _planned(height: Array, foresight: EnsembleRollout, reach: Reach, config: SculptorConfig) -> FloatArray:
    """Actions [N, 5] planned as on a robot, with a scan after every few actions; scans are the model's predictions."""
    made: list[FloatArray] = []
    left = np.zeros((0, 5))
    while len(made) < ACTIONS:
        now = plan(
            height, foresight, reach, config=config, count=ACTIONS - len(made), item=(len(made),), begun=left
        ).actions
        if len(now) == 0:
            break
        made += list(now[:BATCH])
        height, left = foresight.roll_out(height, now[:BATCH]).mean(axis=0), now[BATCH:]
    return np.array(made).reshape(-1, 5)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="noise", description=__doc__)
    parser.add_argument("--material", required=True)
    parser.add_argument("--models", required=True, type=Path, help="push models are kept here")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", required=True, type=Path)
    main(parser.parse_args())
