"""Time of push predictions and of a plan of 150 pushes for scans of 512 × 512 pixels, as the lean runner makes it.

`python -m benchmarks.push_plans --model models/push_foam/weights --out FOLDER [--goal knot]` prints processor times of
one thread and writes a picture of the clay, the goal and the predicted result. The clay follows the model, so that no
studio's time is counted: as in a sculpture, four pushes of a plan are made before the next.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from pentimento.bundle.graphs import GraphClay
from pentimento.contracts.frames import image_shape
from pentimento.contracts.images import write_png
from pentimento.control.sculptor import reach_for, seen_m
from pentimento.deploy.graphs import session
from pentimento.deploy.push_graphs import clay_facts, clay_graphs
from pentimento.dynamics.pushes.push_model import planned_members, read_push_model
from pentimento.goals3d.reliefs import place, soften
from pentimento.goals3d.shading import photograph
from pentimento.planning.objectives import ClayObjective
from pentimento.planning.pushes.goal import fit_goal
from pentimento.planning.pushes.rollout import EnsembleRollout, PushModel
from pentimento.planning.pushes.scales import ScanObjective, plan_for_scan, resampled
from studies.sculpting.clay import robot_with, settings
from studies.sculpting.reliefs import ACTIONS, DEPTH_M, MATERIAL, SIDE_PX, SIDE_SHARE, TOOL
from studies.sculpting.shapes import face, knot

_PUSH = np.array([0.09, 0.1, 0.3, 0.02, 0.005])


def main(arguments: argparse.Namespace) -> None:
    """Print the times; write `<goal>.png` and `<goal>.npy`, the actions, into `--out`."""
    torch.set_num_threads(1)
    given, model = settings(Path("params.yaml")), read_push_model(arguments.model)
    sculpting, facts = given.sculpting, model.facts
    robot, end_effector = robot_with(MATERIAL, TOOL, SIDE_PX, 1)
    scan = robot.scan()
    window_m, (height, _) = scan.window_m, seen_m(scan)
    grid = image_shape(window_m, facts.crop.pixels_per_m)
    start = resampled(height, grid)
    members = planned_members(model, window_m)
    for each in (start, height):
        _say(f"PyTorch, push and gradient on {each.shape[0]} x {each.shape[1]}", lambda on=each: _push(members[0], on))
    lean = tuple(_lean(member, facts, grid, str(number)) for number, member in enumerate(members))
    _say(f"lean runner, push and gradient on {grid[0]} x {grid[1]}", lambda: _push(lean[0], start))
    relief = soften(
        place({"face": face, "knot": knot}[arguments.goal](256), (SIDE_PX, SIDE_PX), SIDE_SHARE),
        sculpting.edge_blur_m * SIDE_PX / robot.area_m[0],
    )
    goal = fit_goal(relief, height, replace(sculpting.fit, depth_m=DEPTH_M)).height_m
    of_scan = ClayObjective(goal, window_m, sculpting.planner.weights)
    on_grid = EnsembleRollout(lean, ScanObjective(of_scan, height, start), sculpting.planner.disagreement_weight)
    _say(
        f"the same, with value and gradient on {SIDE_PX} x {SIDE_PX}",
        lambda: on_grid.value_and_gradient(start, _PUSH[None]),
    )
    _say("values of 32 alternatives", lambda: on_grid.values_after(on_grid.start(start), np.tile(_PUSH, (32, 1))))
    foresight = EnsembleRollout(lean, of_scan, sculpting.planner.disagreement_weight)
    reach = reach_for(end_effector, robot.area_m, sculpting.planner.edge_m)
    clay, begun = height, np.zeros((0, 5))
    made: list[np.ndarray] = []
    cpu, wall, every = 0.0, 0.0, sculpting.execution.replan_every
    while len(made) < arguments.pushes:
        starts = time.process_time(), time.perf_counter()
        plan = plan_for_scan(
            clay, foresight.following(np.array(made).reshape(-1, 5)), reach, grid=grid, config=sculpting.planner,
            count=arguments.pushes - len(made), item=(0, len(made)), begun=begun,
        )  # fmt: skip
        cpu, wall = cpu + time.process_time() - starts[0], wall + time.perf_counter() - starts[1]
        if len(plan.actions) == 0:
            break
        due = min(every, len(plan.actions))
        made += list(plan.actions[:due])
        clay, begun = plan.predicted_m[due], plan.actions[due:]
        errors = [(float(error(clay)), float(error(height))) for error in (of_scan.error_3d_mm2, of_scan.visual_error)]
        removed = ", ".join(
            f"{name} {1 - now / first:.0%}" for name, (now, first) in zip(("height", "slope"), errors, strict=True)
        )
        print(
            f"{len(made)} pushes planned in {cpu:.1f} s of the processor, {wall:.0f} s; predicted: {removed}",
            flush=True,
        )
        arguments.out.mkdir(parents=True, exist_ok=True)
        np.save(arguments.out / f"{arguments.goal}.npy", np.array(made))
    write_png(
        arguments.out / f"{arguments.goal}.png",
        np.hstack([photograph(each, window_m, 1) for each in (height, goal, clay)]),
    )


def _push(model: PushModel, height_m: np.ndarray) -> None:
    after, pull = model.step(height_m, _PUSH)
    pull(np.ones_like(after))


def _lean(member: Any, facts: Any, grid: tuple[int, int], name: str) -> GraphClay:
    """A member as the bundle has it."""
    graphs = clay_graphs(name, member, facts, shape=grid, tolerance=1e-4, models=())
    opened = {key: session(graph.content, {}) for key, graph in graphs.items()}

    def ask(key: str, *arrays: Any) -> list[Any]:
        ports = graphs[key].inputs
        return list(opened[key].run(None, {p.name: a for p, a in zip(ports, arrays, strict=True)}))

    return GraphClay(ask, name, clay_facts([member], facts, grid, None))


def _say(what: str, call: Callable[[], object]) -> None:
    call()
    times = []
    for _ in range(3):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    print(f"{what}: {1e3 * min(times):.1f} ms", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="push_plans", description=__doc__)
    parser.add_argument("--model", required=True, type=Path, help="weights of a push model of foam")
    parser.add_argument("--goal", choices=("face", "knot"), default="knot")
    parser.add_argument("--pushes", type=int, default=ACTIONS)
    parser.add_argument("--out", required=True, type=Path)
    main(parser.parse_args())
