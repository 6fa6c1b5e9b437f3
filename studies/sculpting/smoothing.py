"""A thin line pressed into dough is smoothed in ten pushes, planned by slopes or by Chamfer distance (Figure 7.12).

`python -m studies.sculpting.smoothing --tool flat --models DIR --out FILE.json [--seed 1]`
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.images import write_png
from pentimento.control.execute_push import execute_push
from pentimento.control.push_safety import GuardedSculptingRobot, push_envelope_for
from pentimento.control.sculptor import reach_for, seen_m
from pentimento.goals3d.shading import photograph
from pentimento.planning.objectives import ClayObjective, Weights
from pentimento.planning.pushes.goal import fit_goal
from pentimento.planning.pushes.plan import plan
from pentimento.planning.pushes.rollout import EnsembleRollout, PushModel
from pentimento.robots.tools import load_end_effector
from pentimento.robots.virtual import virtual_sculpting_robot
from studies.sculpting.chamfer import ChamferObjective
from studies.sculpting.clay import Settings, model_of, settings

Array = NDArray[np.float32]

ACTIONS = 10
MATERIAL = "dough"
LINE_M = np.array([[0.1, 0.056 + 0.022 * number, 0.0, 0.0, 0.004] for number in range(5)])
"""Pokes with the edge, 24 mm wide and 6 mm long, one beside the other: a line along y."""
VOXEL_M = 0.011
"""Leaves some 330 points of the slab; published planners of this kind use 300 (thesis 7.1)."""


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`, and a picture beside it."""
    torch.set_num_threads(1)
    given = settings(Path("params.yaml"))
    said: dict[str, Any] = {"tool": arguments.tool, "seed": arguments.seed, "actions": ACTIONS}
    fresh, _ = seen_m(virtual_sculpting_robot(MATERIAL, given.sculpt.scan_pixels, arguments.seed).scan())
    smooth = ClayObjective(_goal(fresh, given), (0.0, 0.0, 0.2, 0.2), Weights(1.0, 1.0))
    said["fresh_visual_error"] = float(smooth.visual_error(fresh))
    shown: list[NDArray[np.uint8]] = []
    for name in ("visual", "chamfer"):  # each in the same dough, with the same pushes
        heights, window_m = _smoothed(name, arguments, given)
        goal = _goal(heights[0], given)
        judge = ClayObjective(goal, window_m, Weights(1.0, 1.0))
        chamfer = ChamferObjective(goal, window_m, VOXEL_M)
        said[name] = {
            "visual_error": judge.visual_error(heights).tolist(),
            "error_3d_mm2": judge.error_3d_mm2(heights).tolist(),
            "chamfer_mm2": chamfer.values(heights).tolist(),
        }
        shown += [photograph(each, window_m, 2) for each in (heights[0], heights[-1])]
        before, after = said[name]["visual_error"][0], said[name]["visual_error"][-1]
        print(name, f"visual {before:.4f} -> {after:.4f}")
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    write_png(arguments.out.with_suffix(".png"), np.hstack([shown[0], shown[1], shown[3]]))
    atomic_write(arguments.out, (json.dumps(said, indent=1) + "\n").encode())


def _smoothed(name: str, arguments: argparse.Namespace, given: Settings) -> tuple[Array, NDArray[np.float64]]:
    """Heights [11, H, W] from the line on, planned by one objective, one action at a time."""
    raw = virtual_sculpting_robot(MATERIAL, given.sculpt.scan_pixels, arguments.seed)
    edge, tool = load_end_effector("edge"), load_end_effector(arguments.tool)
    robot = GuardedSculptingRobot(raw, push_envelope_for(edge, raw.area_m))
    robot.change_tool(edge)
    scan = robot.scan()
    for poke in LINE_M:
        scan = execute_push(
            robot,
            edge,
            poke,
            before=scan,
            speed_m_s=edge.speed_m_s,
            dwell_s=0.5,
            retract_speed_m_s=given.sculpting.execution.retract_speed_m_s,
        ).after
    robot = GuardedSculptingRobot(raw, push_envelope_for(tool, raw.area_m))
    robot.change_tool(tool)
    scan = robot.scan()
    members = model_of(MATERIAL, arguments.tool, given, arguments.models, scan.window_m)
    heights = [seen_m(scan)[0]]
    goal = _goal(heights[0], given)
    objective = (
        ClayObjective(goal, scan.window_m, Weights(0.0, 1.0))
        if name == "visual"
        else ChamferObjective(goal, scan.window_m, VOXEL_M)
    )
    for number in range(ACTIONS):
        action = _next(heights[-1], objective, members, tool=tool.name, given=given, area_m=raw.area_m, number=number)
        if action is None:
            heights.append(heights[-1])
            continue
        scan = execute_push(
            robot,
            tool,
            action,
            before=scan,
            speed_m_s=tool.speed_m_s,
            dwell_s=0.5,
            retract_speed_m_s=given.sculpting.execution.retract_speed_m_s,
        ).after
        heights.append(seen_m(scan)[0])
    return np.stack(heights), scan.window_m


def _next(
    height: Array,
    objective: ClayObjective,
    members: tuple[PushModel, ...],
    *,
    tool: str,
    given: Settings,
    area_m: tuple[float, float],
    number: int,
) -> NDArray[np.float64] | None:
    """The best action of many tried, then refined; None where none is expected to help.

    The error in slope is refined by its gradient; the Chamfer distance has none here and is refined by
    cross-entropy with as many evaluations.
    """
    refine: Literal["gradient", "cross_entropy"] = "cross_entropy"
    if not isinstance(objective, ChamferObjective):
        refine = "gradient"
    config = replace(
        given.sculpting.planner, horizon=1, screened=0, candidates=64, rounds=2, guided_share=0.5, refine=refine,
        iterations=10, samples=8,
    )  # fmt: skip
    reach = reach_for(load_end_effector(tool), area_m, config.edge_m)
    actions = plan(
        height, EnsembleRollout(members, objective, 0.0), reach, config=config, count=1, item=(number,)
    ).actions
    return actions[0] if len(actions) else None


def _goal(height: Array, given: Settings) -> Array:
    """The goal: the same volume of clay, level except at the border."""
    return fit_goal(np.zeros(height.shape), height, replace(given.sculpting.fit, rising_share=1.0)).height_m


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="smoothing", description=__doc__)
    parser.add_argument("--tool", required=True)
    parser.add_argument("--models", required=True, type=Path, help="push models are kept here")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", required=True, type=Path)
    main(parser.parse_args())
