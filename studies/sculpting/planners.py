"""The push planner beside others at equal planning time: greedy choice, the cross-entropy method, a particle model.

`python -m studies.sculpting.planners --material foam --out DIR [--seeds 1] [--goals letter:A …]`

Every planner has the same processor time for a plan. The planner of the project sets that time. The others have one
number each that fills it, the candidates for each action; it is fitted on a slab and goals that are not compared, and
kept in `candidates.json`. Processor time depends on what else runs on the machine, so make all runs in one pass: the
planners take turns, goal by goal.
Scans, plans and models are as coarse as in `places`. Each run is a file in `DIR/planners_foam/`, and is not made again;
`DIR/planners_foam.json` sums them up.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from safetensors.torch import load_file, save_file
from torch import Tensor

from pentimento.contracts.atomic import atomic_write
from pentimento.control.execute import Session
from pentimento.control.loop import Hooks
from pentimento.control.sculptor import SculptureProgress, seen_m
from pentimento.dynamics.pushes.evaluation import predict, score, unchanged
from pentimento.dynamics.pushes.measured import PushSamples
from pentimento.dynamics.pushes.push_model import planned_members
from pentimento.dynamics.pushes.training import split_by_action
from pentimento.planning.objectives import ClayObjective
from pentimento.planning.pushes.config import SculptorConfig
from pentimento.planning.pushes.rollout import PushModel
from studies.sculpting.clay import Clock, TimedSculptor, goal_on, once, pushes_of, robot_with
from studies.sculpting.particles import ParticleClay, ParticleNetwork, ParticleTraining, fit_particles, moved
from studies.sculpting.places import PIXELS
from studies.sculpting.uncertainty import ACTIONS, TOOL, WINDOW_M, Bench, prepared

GOALS = (
    "letter:A", "letter:E", "letter:S", "letter:X", "shape:cross", "shape:dome", "shape:pyramid", "shape:ridge",
    "shape:ripple", "face", "knot",
)  # fmt: skip
TEST_SEED, TEST_PUSHES = 31, 40
"""Slab and number of the pushes on which predictions are compared."""
FIT_SEED, FIT_GOALS = 99, ("letter:T", "letter:O")
"""Slab and goals on which the candidates are fitted to the time."""
FIT_CANDIDATES = (8, 48)
ROUNDS, ITERATIONS = 1, 2
"""Of the planners that do not screen: rounds of variations, and iterations over the whole sequence."""
ERRORS = ("error_3d_mm2", "visual_error", "value")


@dataclass(frozen=True)
class Planner:
    """One way to plan."""

    model: Literal["network", "particles"]
    refine: Literal["newton", "gradient", "cross_entropy", "none"]
    screened: bool = False
    """Whether it screens all places, as the project's planner does. The others vary their best candidates once."""
    samples: int = 2
    """Of each iteration of the cross-entropy method."""
    heights_only: bool = False
    """Whether it lowers the error in height alone, as RoboCraft does, in place of the project's objective."""


OURS = "ours"
NOTHING = "nothing"
PLANNERS = {
    OURS: Planner("network", "newton", screened=True),
    "screened": Planner("network", "none", screened=True),
    "greedy": Planner("network", "none"),
    "gradient": Planner("network", "gradient"),
    "cross-entropy": Planner("network", "cross_entropy", samples=4),
    "particles, heights": Planner("particles", "none", heights_only=True),
    "particles, our objective": Planner("particles", "none"),
}


def main(arguments: argparse.Namespace) -> None:
    """Write `DIR/planners_<material>.json`."""
    torch.set_num_threads(1)
    folder = arguments.out / f"planners_{arguments.material}"
    bench = prepared(arguments.material, folder, apart=False)
    setting = bench.given.sculpt.settings[arguments.material].sculpting
    sculpting = replace(bench.given.sculpting, fit=setting.fit)
    bench = replace(bench, given=replace(bench.given, sculpting=sculpting))
    network = _particles(bench)
    models: dict[str, PushModel] = {
        "network": planned_members(bench.models["one"], WINDOW_M)[0],
        "particles": ParticleClay(network, window_m=WINDOW_M, tool=TOOL),
    }
    predicted = once(folder, "predictions", partial(_predictions, bench, network))
    candidates = once(folder, "candidates", partial(_fitted_candidates, bench, models))
    runs = [
        once(
            folder, f"sculpture_{seed}_{goal.rpartition(':')[2]}_{name.replace(' ', '_').replace(',', '')}",
            partial(_sculpted, bench, models, seed, goal, name=name, candidates=candidates[name]),
        )
        for seed in arguments.seeds for goal in arguments.goals for name in PLANNERS
    ]  # fmt: skip
    said = {
        "material": arguments.material, "actions": ACTIONS, "pixels": PIXELS, "predictions": predicted,
        "screened": bench.given.sculpting.planner.screened,
        "test": {"seed": TEST_SEED, "pushes": TEST_PUSHES}, "fit_seed": FIT_SEED, "candidates": candidates,
        "epochs": {"network": bench.given.training.epochs, "particles": ParticleTraining().epochs},
        "runs": runs,
    }  # fmt: skip
    file = arguments.out / f"planners_{arguments.material}.json"
    atomic_write(file, (json.dumps(said, indent=1) + "\n").encode())


def _particles(bench: Bench) -> ParticleNetwork:
    """The particle model, trained on the pushes that the network was trained on."""
    file = bench.folder / "particles.safetensors"
    network = ParticleNetwork()
    if file.is_file():
        network.load_state_dict(load_file(file))
        return network.eval().requires_grad_(False)
    pushes = pushes_of(bench.material, TOOL, bench.given, bench.folder, bench.given.collection.seed)
    network = fit_particles(split_by_action(pushes, 0.25, 0)[0], ParticleTraining())
    save_file(network.state_dict(), file)
    return network


def _predictions(bench: Bench, network: ParticleNetwork) -> dict[str, Any]:
    """Scores of both models, and of no change, on pushes into another slab."""
    given = replace(bench.given, collection=replace(bench.given.collection, pushes=TEST_PUSHES))
    test = pushes_of(bench.material, TOOL, given, bench.folder, TEST_SEED)
    model = bench.models["one"]
    heights = {
        "network": predict(model, test), "particles": _after_particles(network, test), "no change": unchanged(test)
    }  # fmt: skip
    return {name: asdict(score(after, test, model.facts.crop)) for name, after in heights.items()}


def _after_particles(network: ParticleNetwork, samples: PushSamples) -> Tensor:
    arrays = (samples.before, samples.window_m, samples.action)
    with torch.no_grad():
        return moved(network, *(torch.from_numpy(each.astype(np.float32)) for each in arrays))


def _fitted_candidates(bench: Bench, models: dict[str, PushModel]) -> dict[str, int]:
    """The candidates with which each planner takes as long as ours: time is taken as linear in them."""
    ours = bench.given.sculpting.planner.candidates

    def cpu_s(name: str, candidates: int) -> float:
        runs = [
            _sculpted(bench, models, FIT_SEED, goal, name=name, candidates=candidates)["cpu_s"] for goal in FIT_GOALS
        ]
        return float(np.mean(runs))

    wanted = cpu_s(OURS, ours)
    found = {OURS: ours}
    for name in PLANNERS:
        if name != OURS:
            few, many = (cpu_s(name, candidates) for candidates in FIT_CANDIDATES)
            slope = (many - few) / (FIT_CANDIDATES[1] - FIT_CANDIDATES[0])
            found[name] = max(round(FIT_CANDIDATES[0] + (wanted - few) / slope), 1)
    return found


def _config(bench: Bench, planner: Planner, candidates: int) -> SculptorConfig:
    given = bench.given.sculpting.planner
    weights = replace(given.weights, visual=0.0) if planner.heights_only else given.weights
    return replace(
        given, weights=weights, disagreement_weight=0.0, candidates=candidates, refine=planner.refine,
        iterations=ITERATIONS if planner.refine != "newton" else given.iterations, samples=planner.samples,
        screened=given.screened if planner.screened else 0, rounds=given.rounds if planner.screened else ROUNDS,
    )  # fmt: skip


def _sculpted(
    bench: Bench, models: dict[str, PushModel], seed: int, goal: str, *, name: str, candidates: int
) -> dict[str, Any]:
    """Errors before and after, from scans, and the processor time of all plans."""
    given, planner = bench.given, PLANNERS[name]
    robot, end_effector = robot_with(bench.material, TOOL, PIXELS, seed)
    goal_m = goal_on(goal, seen_m(robot.scan())[0], given.sculpting)
    sculptor = TimedSculptor(
        robot=robot, end_effector=end_effector, material=bench.material, goal_m=goal_m,
        members=(models[planner.model],), grid=given.grid, config=_config(bench, planner, candidates),
        execution=given.sculpting.execution, count=ACTIONS, session=Session("planners", robot.clock_s), item=0,
        record=lambda _: None, clock=Clock(),
    )  # fmt: skip
    begun, _ = sculptor.begin()
    end, stopped = sculptor.run(begun, Hooks[SculptureProgress]())
    objective = ClayObjective(goal_m, WINDOW_M, given.sculpting.planner.weights)
    ends = np.stack([end.heights_m[0], end.heights_m[-1]])
    return {
        "planner": name, "seed": seed, "goal": goal, "candidates": candidates, "actions": len(end.actions),
        "stopped": stopped, "error_3d_mm2": objective.error_3d_mm2(ends).tolist(),
        "visual_error": objective.visual_error(ends).tolist(), "value": objective.values(ends).tolist(),
        "cpu_s": sculptor.clock.cpu_s, "plans": sculptor.clock.plans,
    }  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="planners", description=__doc__)
    parser.add_argument("--material", required=True)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--goals", nargs="+", default=list(GOALS))
    parser.add_argument("--out", required=True, type=Path)
    main(parser.parse_args())
