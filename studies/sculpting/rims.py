"""Ridges, walls and strokes that rise above dough, by pinches and by pushes; and sunken goals, where pushes should do.

`python -m studies.sculpting.rims --models DIR --out DIR/rims_dough [--seeds 1 2 3 4 5]`

Nothing is added: what rises comes from beside it. Each plan of the third arm is the better one of pushes and pinches.
Settings are as coarse as those of ``places``. Each run is a file of the folder `--out`, and is not made again.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.images import read_image, write_png
from pentimento.control.execute_push import execute_push
from pentimento.control.push_safety import GuardedSculptingRobot, push_envelope_for
from pentimento.control.sculptor import reach_for, seen_m
from pentimento.goals3d.shading import photograph
from pentimento.planning.objectives import ClayObjective
from pentimento.planning.pushes.goal import border_mask
from pentimento.planning.pushes.plan import PushPlan
from pentimento.planning.pushes.rollout import EnsembleRollout, PushModel
from pentimento.planning.pushes.scales import plan_for_scan
from pentimento.robots.tools import load_end_effector
from pentimento.robots.virtual import virtual_sculpting_robot
from studies.sculpting.clay import Settings, model_of, settings
from studies.sculpting.places import ACTIONS, PIXELS, coarse

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

MATERIAL = "dough"
ARMS = {"push": ("ball",), "pinch": ("gripper",), "both": ("ball", "gripper")}
SIDE_M = 0.2
"""Of the slab."""
WINDOW_M = np.array([0.0, 0.0, SIDE_M, SIDE_M])
_FINE_PX = 512
_EDGE_BLUR_M = 0.0028


class Goal(NamedTuple):
    """Lines that stand above or lie below the surface. Places are metres from the slab's middle, x right and y up."""

    lines: tuple[tuple[tuple[float, float], ...], ...]
    width_m: float
    height_m: float
    """Below 0 where the lines are sunken."""
    beside_m: tuple[float, float] = (0.0, 0.0)
    """Width and depth of the sides from which material is taken."""


WIDTH_M, RAISED_M, SUNKEN_M, BESIDE_M = 0.016, 0.002, -0.0035, (0.016, 0.002)
"""Of the raised and the sunken lines. Five pinches side by side, closed by 28 mm and 6 mm deep, leave a ridge as wide
between the closed fingers, on average 1.9 mm high, and dents of 16 mm on both sides, on average 2.0 mm deep (seed 11).
One pinch raises its highest place by 1.4 mm (4 mm deep) to 3.9 mm (12 mm deep)."""
_L = (((-0.025, 0.035), (-0.025, -0.035), (0.02, -0.035)),)
_CROSS = (((-0.035, 0.0), (0.035, 0.0)), ((0.0, -0.035), (0.0, 0.035)))
_RING = (
    tuple((0.028 * float(np.cos(angle)), 0.028 * float(np.sin(angle))) for angle in np.linspace(0, 2 * np.pi, 73)),
)
GOALS = {
    "ridge": Goal((((-0.03, 0.0), (0.03, 0.0)),), WIDTH_M, RAISED_M, BESIDE_M),
    "ring wall": Goal(_RING, WIDTH_M, RAISED_M, BESIDE_M),
    "raised cross": Goal(_CROSS, WIDTH_M, RAISED_M, BESIDE_M),
    "raised L": Goal(_L, WIDTH_M, RAISED_M, BESIDE_M),
    "sunken L": Goal(_L, WIDTH_M, SUNKEN_M),
    "wide hollow": Goal((((0.0, 0.0), (0.0, 0.0)),), 0.06, SUNKEN_M),
}


def main(arguments: argparse.Namespace) -> None:
    """Write a file for each run, and a picture of each goal at the first seed: before, goal, and each arm's result."""
    torch.set_num_threads(1)
    given = coarse(settings(Path("params.yaml")))
    tools = sorted({tool for each in ARMS.values() for tool in each})
    members = {tool: model_of(MATERIAL, tool, given, arguments.models, WINDOW_M) for tool in tools}
    arguments.out.mkdir(parents=True, exist_ok=True)
    for seed in arguments.seeds:
        for arm, hands in ARMS.items():
            for name in GOALS:
                file = arguments.out / f"{name.replace(' ', '_')}_{arm}_{seed}.json"
                if not file.is_file():
                    made = _sculpted(name, seed, {tool: members[tool] for tool in hands}, given)
                    _write(file, {"goal": name, "arm": arm, "seed": seed}, made, given)
    rows = []
    for name in GOALS:
        files = [arguments.out / f"{name.replace(' ', '_')}_{arm}_{arguments.seeds[0]}.png" for arm in ARMS]
        shown = [np.hsplit(read_image(file), 3) for file in files]
        rows.append(np.hstack([*shown[0][:2], *(each[2] for each in shown)]))
    write_png(arguments.out / "rims.png", np.vstack(rows))


def relief_m(goal: Goal, shape: tuple[int, int]) -> FloatArray:
    """The goal [H, W] of a square slab of ``SIDE_M`` in metres above its surface, before volumes are balanced."""
    drawn = np.ones((_FINE_PX, _FINE_PX), np.uint8)
    for line in goal.lines:
        places = (0.5 + np.array(line) * (1, -1) / SIDE_M) * _FINE_PX
        cv2.polylines(drawn, [np.rint(places - 0.5).astype(np.int32)], False, 0)
    away_m = cv2.distanceTransform(drawn, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * SIDE_M / _FINE_PX
    width_m, depth_m = goal.beside_m
    relief = np.where(away_m < goal.width_m / 2, goal.height_m, 0.0)
    relief -= np.where((away_m >= goal.width_m / 2) & (away_m < goal.width_m / 2 + width_m), depth_m, 0.0)
    blurred = cv2.GaussianBlur(relief, (0, 0), _EDGE_BLUR_M * _FINE_PX / SIDE_M)
    return np.asarray(cv2.resize(blurred, shape[::-1], interpolation=cv2.INTER_AREA))


def goal_m(relief: FloatArray, height_m: Array, border_share: float) -> Array:
    """The goal [H, W] above the table: the relief on the clay's mean height, with the clay's own volume.

    What the relief has too little of is spread evenly within the border, which stays as it is.
    """
    inside = ~border_mask(height_m.shape, border_share)
    goal = height_m.astype(np.float64)
    goal[inside] = goal[inside].mean() + relief[inside] - relief[inside].mean()
    return goal.astype(np.float32)


@dataclass(frozen=True)
class _Run:
    goal_m: Array
    heights_m: tuple[Array, ...]
    """Before the first and after each action."""
    tools: tuple[str, ...]
    """Of each action."""
    objective: ClayObjective


def _sculpted(name: str, seed: int, members: dict[str, Sequence[PushModel]], given: Settings) -> _Run:
    """Plan and execute as ``control.sculptor`` does; with several tools, each batch is the better of their plans."""
    raw = virtual_sculpting_robot(MATERIAL, PIXELS, seed)
    config, execution = given.sculpting.planner, given.sculpting.execution
    tools = {tool: load_end_effector(tool) for tool in members}
    robots = {tool: GuardedSculptingRobot(raw, push_envelope_for(each, raw.area_m)) for tool, each in tools.items()}
    scan = raw.scan()
    heights, used, values = [seen_m(scan)[0]], list[str](), list[float]()
    goal = goal_m(relief_m(GOALS[name], given.grid), heights[0], given.sculpting.fit.border_share)
    objective = ClayObjective(goal, WINDOW_M, config.weights)
    foresights = {tool: EnsembleRollout(each, objective, config.disagreement_weight) for tool, each in members.items()}
    values.append(float(objective.values(heights[0])))
    while len(used) < ACTIONS and len(values) - 1 - int(np.argmin(values)) < execution.patience:
        plans = {
            tool: plan_for_scan(
                heights[-1], foresights[tool], reach_for(tools[tool], raw.area_m, config.edge_m), grid=given.grid,
                config=config, count=ACTIONS - len(used), item=(0, len(used)),
            )
            for tool in tools
        }  # fmt: skip
        tool = min(plans, key=lambda tool: _promised(plans[tool], execution.replan_every))
        if len(plans[tool].actions) == 0:
            break
        robots[tool].change_tool(tools[tool])
        for action in plans[tool].actions[: execution.replan_every]:
            scan = execute_push(
                robots[tool], tools[tool], action, scan, speed_m_s=tools[tool].speed_m_s, dwell_s=execution.dwell_s,
                retract_speed_m_s=execution.retract_speed_m_s,
            ).after  # fmt: skip
            heights.append(seen_m(scan)[0])
            used.append(tool)
            values.append(float(objective.values(heights[-1])))
    return _Run(goal, tuple(heights), tuple(used), objective)


def _promised(plan: PushPlan, executed: int) -> float:
    """The plan's value after the actions that are executed before the next one."""
    return float(plan.values[min(executed, len(plan.actions))])


def _write(file: Path, run: dict[str, Any], made: _Run, given: Settings) -> None:
    ends = np.stack([made.heights_m[0], made.heights_m[-1]])
    found = run | {
        "error_3d_mm2": made.objective.error_3d_mm2(ends).tolist(),
        "visual_error": made.objective.visual_error(ends).tolist(),
        "rise_mm": _rise_mm(GOALS[run["goal"]], ends[1] - ends[0], made.goal_m - ends[0]),
        "tools": list(made.tools),
    }
    maps = (ends[0], made.goal_m, ends[1])
    write_png(file.with_suffix(".png"), np.hstack([photograph(each, WINDOW_M, 4) for each in maps]))
    # Last, since a run with this file is complete.
    atomic_write(file, (json.dumps(found, indent=1) + "\n").encode())
    print(
        found["goal"],
        found["arm"],
        found["seed"],
        found["error_3d_mm2"],
        found["visual_error"],
        found["rise_mm"],
        flush=True,
    )


def _rise_mm(goal: Goal, change_m: Array, wanted_m: Array) -> list[float]:
    """Mean change of the lines' height, as wanted and as made, where the goal reaches half its height or more."""
    on = np.abs(relief_m(goal, (change_m.shape[0], change_m.shape[1]))) >= abs(goal.height_m) / 2
    on &= np.sign(wanted_m) == np.sign(goal.height_m)
    return [1e3 * float(wanted_m[on].mean()), 1e3 * float(change_m[on].mean())]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="rims", description=__doc__)
    parser.add_argument("--models", required=True, type=Path, help="push models are kept here")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3, 4, 5])
    parser.add_argument("--out", required=True, type=Path)
    main(parser.parse_args())
