"""Goals above the surface, by pushes alone and with placed pellets; and a goal below it as a control.

`python -m studies.sculpting.places --material foam --models DIR --out DIR/places_foam.json [--seeds 1 2 3 4 5]`

Scans, plans and models are coarser than in the other experiments, so that many runs are cheap.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import torch
from numpy.typing import NDArray

from pentimento.collection.places import collect_places
from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.images import write_png
from pentimento.control.execute import Session
from pentimento.control.place_safety import place_envelope_for
from pentimento.control.placing import Placer
from pentimento.control.push_safety import GuardedSculptingRobot, push_envelope_for
from pentimento.control.sculptor import Sculpture, sculpt, seen_m
from pentimento.goals3d.shading import photograph
from pentimento.goals3d.sources import relief_of
from pentimento.planning.objectives import ClayObjective
from pentimento.planning.pushes.goal import fit_goal, raised_goal
from pentimento.planning.pushes.place_fit import fit_places
from pentimento.planning.pushes.rollout import PushModel
from pentimento.robots.driver import SculptingRobot
from pentimento.robots.tools import EndEffector, Feeder, load_end_effector, load_feeder
from pentimento.robots.virtual import virtual_sculpting_robot
from studies.sculpting.clay import Settings, model_of, settings

Array = NDArray[np.float32]

TOOL, FEEDER = "ball", "pellets"
PIXELS = 64
PUSHES, PELLETS = 120, 24
"""Number of pushes that the push model is fitted to."""
ACTIONS = 24
SIDE_SHARE = 0.4
RAISED_M, SUNKEN_M = 0.004, 0.0035
GOALS = {
    "a raised letter": ("letter:L", True),
    "a dome": ("shape:dome", True),
    "a wall of 6 mm": ("wall", True),
    "a sunken letter": ("letter:L", False),
}
"""By name, the source and whether it stands above the surface."""
WALL_PX = 2
"""Its width: 6.25 mm."""


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`, and next to it a picture of the first seed: before, goal, pushes alone, with pellets."""
    torch.set_num_threads(1)
    given = coarse(settings(Path("params.yaml")))
    end_effector, feeder = load_end_effector(TOOL), load_feeder(FEEDER)
    window_m = np.array([0.0, 0.0, 0.2, 0.2])
    members = model_of(arguments.material, TOOL, given, arguments.models, window_m)
    placer = _placer(arguments.material, feeder, end_effector)
    said: dict[str, Any] = {
        "material": arguments.material, "actions": ACTIONS, "pixels": PIXELS, "pellets": PELLETS, "raised_m": RAISED_M,
        "sunken_m": SUNKEN_M, "model": {name: getattr(placer.model, name) for name in ("kept", "unexplained")},
        "goals": {name: {"raised": raised, "runs": []} for name, (_, raised) in GOALS.items()},
    }  # fmt: skip
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    for seed in arguments.seeds:
        shown = []
        for name, (source, raised) in GOALS.items():
            made = {}
            for arm, tools in (("push", None), ("place and push", placer)):
                robot = _robot(arguments.material, end_effector, feeder, seed)
                goal = _goal(source, raised, seen_m(robot.scan())[0], given)
                made[arm] = _sculpted(robot, end_effector, arguments.material, goal, members, given=given, placer=tools)
            run = {"seed": seed} | {arm: _errors(each, goal, window_m, given) for arm, each in made.items()}
            said["goals"][name]["runs"].append(run)
            print(name, run, flush=True)
            maps = (made["push"].heights_m[0], goal, *(each.heights_m[-1] for each in made.values()))
            shown.append(np.hstack([photograph(each, window_m, 4) for each in maps]))
        if seed == arguments.seeds[0]:
            write_png(arguments.out.with_suffix(".png"), np.vstack(shown))
        # After each seed, so that a long run can be looked at.
        atomic_write(arguments.out, (json.dumps(said, indent=1) + "\n").encode())


def coarse(given: Settings) -> Settings:
    """The settings with coarser scans, fewer pushes and shorter plans."""
    side_px = given.training.side_px * PIXELS // given.collection.scan_pixels
    planner = replace(given.sculpting.planner, horizon=4, iterations=2)
    return replace(
        given,
        collection=replace(given.collection, scan_pixels=PIXELS, pushes=PUSHES, repeated=0),
        training=replace(given.training, side_px=side_px),
        sculpting=replace(given.sculpting, planner=planner, side_share=SIDE_SHARE),
    )


def _robot(material: str, end_effector: EndEffector, feeder: Feeder, seed: int) -> SculptingRobot:
    raw = virtual_sculpting_robot(material, PIXELS, seed)
    envelopes = push_envelope_for(end_effector, raw.area_m), place_envelope_for(feeder, raw.area_m)
    return GuardedSculptingRobot(raw, *envelopes)


def _placer(material: str, feeder: Feeder, end_effector: EndEffector) -> Placer:
    robot = _robot(material, end_effector, feeder, 0)
    rows = collect_places(robot, feeder, material, count=PELLETS, edge_m=0.025, seed=0, first=0)
    return Placer(feeder, fit_places(pa.Table.from_pylist(rows)))


def _goal(source: str, raised: bool, height: Array, given: Settings) -> Array:
    sculpting = given.sculpting
    shape = (height.shape[0], height.shape[1])
    if source == "wall":
        relief = np.zeros(shape)
        left = (shape[1] - WALL_PX) // 2
        relief[shape[0] // 4 : -shape[0] // 4, left : left + WALL_PX] = 1.0
        return raised_goal(relief, height, raised_m=RAISED_M, border_share=sculpting.fit.border_share).height_m
    soften_px = sculpting.edge_blur_m * shape[1] / 0.2
    relief = relief_of(source, shape, sculpting.side_share, soften_px=soften_px)
    if not raised:
        return fit_goal(relief, height, replace(sculpting.fit, depth_m=SUNKEN_M)).height_m
    up = -relief if source.startswith("letter:") else relief  # letters are sunken
    return raised_goal(up, height, raised_m=RAISED_M, border_share=sculpting.fit.border_share).height_m


def _sculpted(
    robot: SculptingRobot,
    end_effector: EndEffector,
    material: str,
    goal_m: Array,
    members: tuple[PushModel, ...],
    *,
    given: Settings,
    placer: Placer | None,
) -> Sculpture:
    return sculpt(
        robot, end_effector, material, goal_m=goal_m, members=members, grid=given.grid, config=given.sculpting.planner,
        execution=given.sculpting.execution, count=ACTIONS, session=Session("places", robot.clock_s), item=0,
        log=lambda *_: None, placer=placer,
    )  # fmt: skip


def _errors(made: Sculpture, goal: Array, window_m: NDArray[np.float64], given: Settings) -> dict[str, Any]:
    """Errors before and after, and how many actions there were of each kind."""
    objective = ClayObjective(goal, window_m, given.sculpting.planner.weights)
    ends = made.heights_m[[0, -1]]
    placed = int(np.isfinite(made.volumes_m3).sum())
    return {
        "error_3d_mm2": objective.error_3d_mm2(ends).tolist(),
        "visual_error": objective.visual_error(ends).tolist(),
        "pellets": placed,
        "pushes": len(made.actions) - placed,
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="places", description=__doc__)
    parser.add_argument("--material", required=True)
    parser.add_argument("--models", required=True, type=Path, help="push models are kept here")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3, 4, 5])
    parser.add_argument("--out", required=True, type=Path)
    main(parser.parse_args())
