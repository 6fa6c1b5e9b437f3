"""What push models know of their own errors, what plans gain by it, and a loss of slopes that noise spoils later.

`python -m studies.sculpting.uncertainty --material foam --out DIR [--seeds 1 2 3 4 5] [--parts intervals sculptures …]`

Each run is a file in `DIR/uncertainty_foam/`, and is not made again; `DIR/uncertainty_foam.json` sums them up. Scans,
plans and models are as coarse as in `places`, so that many runs are cheap. Four parts:

- `intervals`: 90 % intervals of the change of height, calibrated on pushes that the networks did not see, on pushes of
  other seeds (another slab, other actions);
- `sculptures`: goals in the studio, by one network and by three, with and without the cost of what they do not know;
- `actions`: noise in the actions of a plan (thesis Figure 7.14), unknown to the plan or known;
- `scans`: noise of the scans that plans are made on, with slopes of neighbouring pixels or at a scale.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.contracts.atomic import atomic_folder, atomic_write
from pentimento.control.execute import Session
from pentimento.control.sculptor import reach_for, sculpt, seen_m
from pentimento.dynamics.pushes.last_layers import fit_last_layers
from pentimento.dynamics.pushes.measured import PushSamples
from pentimento.dynamics.pushes.param2deform import Param2Deform
from pentimento.dynamics.pushes.pose import in_pose
from pentimento.dynamics.pushes.push_model import PushModel, planned_members, read_push_model, write_push_model
from pentimento.dynamics.pushes.training import crop_for, split_by_action, train
from pentimento.dynamics.pushes.uncertainty import (
    Intervals,
    Pixels,
    fit_intervals,
    fit_unexplained,
    pixels_of,
)
from pentimento.planning.objectives import ClayObjective, Weights, weights_for_scans
from pentimento.planning.pushes.config import Reach, SculptorConfig
from pentimento.planning.pushes.plan import plan
from pentimento.planning.pushes.rollout import EnsembleRollout, Unexplained
from pentimento.planning.pushes.rollout import PushModel as PlannedModel
from studies.sculpting.clay import Settings, goal_on, once, pushes_of, robot_with, settings, unheard
from studies.sculpting.noise import AT_ONE
from studies.sculpting.places import PIXELS, coarse

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

TOOL = "ball"
WINDOW_M = np.array([0.0, 0.0, 0.2, 0.2])
TEST_SEEDS, TEST_PUSHES = (21, 22, 23), 40
GOALS = ("shape:cross", "letter:A", "letter:S")
SIDE_SHARE = 0.7
ACTIONS, BATCH = 24, 4
VISUAL = 10.0
"""Weight of the slopes in the parts `actions` and `scans`, as in `noise`."""
LEVELS, DRAWS = (0.1, 0.2, 0.3, 0.5, 1.0, 2.0), 6
PLANS = {
    "plain": (0.0, 0.0), "slopes at 4 mm": (0.004, 0.0), "noise known": (0.0, 1.0),
    "noise known, half the weight": (0.0, 0.5),
}  # fmt: skip
"""Of the part `actions`: scale of the slopes, and weight of what the noise makes unpredictable."""
SCAN_NOISE_M = (0.0, 0.0001, 0.0002, 0.0004)
ERRORS = ("error_3d_mm2", "visual_error", "value")
PARTS = ("intervals", "sculptures", "actions", "scans")


@dataclass(frozen=True)
class Arm:
    """How goals are planned."""

    model: str
    weight: float
    unexplained: bool
    scale_m: float = 0.0


ARMS = {
    "one network": Arm("one", 0.0, False),
    "three, their spread": Arm("three", 1.0, False),
    "one, unexplained": Arm("one", 1.0, True),
    "one, slopes at 4 mm": Arm("one", 0.0, False, 0.004),
}


@dataclass(frozen=True)
class Bench:
    """Models and settings of the experiments."""

    material: str
    given: Settings
    models: dict[str, PushModel]
    validation: PushSamples
    folder: Path

    def once(self, name: str, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """What ``make`` returns, from its file if there is one."""
        return once(self.folder, name, make)


def main(arguments: argparse.Namespace) -> None:
    """Write `DIR/uncertainty_<material>.json`."""
    torch.set_num_threads(1)
    folder = arguments.out / f"uncertainty_{arguments.material}"
    bench = prepared(arguments.material, folder, apart="intervals" in arguments.parts)
    made: dict[str, Callable[[Bench, Sequence[int]], Any]] = {
        "intervals": intervals_of, "sculptures": sculptures, "actions": noisy_actions, "scans": noisy_scans,
    }  # fmt: skip
    said = {"material": arguments.material, "seeds": arguments.seeds, "pushes": ACTIONS, "draws": DRAWS}
    said |= {part: made[part](bench, arguments.seeds) for part in PARTS if part in arguments.parts}
    file = arguments.out / f"uncertainty_{arguments.material}.json"
    atomic_write(file, (json.dumps(said, indent=1) + "\n").encode())


def prepared(material: str, folder: Path, apart: bool) -> Bench:
    """Train one network, three last layers on it, and with ``apart`` two other networks, on the same pushes."""
    given = coarse(settings(Path("params.yaml")))
    given = replace(given, sculpting=replace(given.sculpting, side_share=SIDE_SHARE))
    folder.mkdir(parents=True, exist_ok=True)
    training, validation = split_by_action(pushes_of(material, TOOL, given, folder, given.collection.seed), 0.25, 0)
    crop = crop_for(training, given.training)
    seen = in_pose(training, crop)

    def trained(name: str, seed: int) -> PushModel:
        if not (folder / name).is_dir():
            config = replace(given.training, members=1, seed=seed)
            model = train(seen, "push", [(material, TOOL)], crop=crop, config=config, log=unheard)
            with atomic_folder(folder / name) as out:
                write_push_model(model, out)
        return read_push_model(folder / name)

    one = trained("one", 0)
    three = _side_by_side(one, one, one)
    layers = [member for member in three.members if isinstance(member, Param2Deform)]
    fit_last_layers(layers, seen, crop, visual_weight=given.training.visual_weight, seed=0)
    models = {"one": one, "three": three.requires_grad_(False)}
    if apart:
        models["apart"] = _side_by_side(one, *(trained(f"apart{seed}", seed) for seed in (1, 2)))
    return Bench(material, given, models, validation, folder)


def _side_by_side(*networks: PushModel) -> PushModel:
    """An ensemble of copies of models of one network each."""
    model = PushModel(replace(networks[0].facts, members=len(networks)))
    for member, network in zip(model.members, networks, strict=True):
        member.load_state_dict(network.members[0].state_dict())
    return model.eval()


def intervals_of(bench: Bench, _seeds: Sequence[int]) -> dict[str, Any]:
    """Coverage, mean width and interval score (Gneiting & Raftery 2007) of 90 % intervals on pushes of other seeds."""
    crop = bench.models["one"].facts.crop
    found: dict[str, Any] = {}
    given = replace(bench.given, collection=replace(bench.given.collection, pushes=TEST_PUSHES))
    tests = [in_pose(pushes_of(bench.material, TOOL, given, bench.folder, seed), crop) for seed in TEST_SEEDS]
    for name, model in bench.models.items():
        known = pixels_of(model, in_pose(bench.validation, crop))
        fits = {"as fitted": fit_intervals(known)}
        fits["of one width"] = _of_one_width(known)
        unseen = [pixels_of(model, test) for test in tests]
        moved, expected, seen = (
            [pixels.pick(getattr(pixels, area)) for pixels in unseen] for area in ("moved", "expected", "seen")
        )
        found[name] = {
            "mean_square_mm2": float(np.mean([np.mean(pixels.residual_mm**2) for pixels in unseen])),
            "spread_mm2": float(np.mean([np.mean(pixels.spread_mm2) for pixels in moved])),
            "residual_mm2": float(np.mean([np.mean(pixels.residual_mm**2) for pixels in moved])),
            "spread_alone": float(np.mean([_within_spread(pixels) for pixels in moved])),
        }
        for kind, fit in fits.items():
            found[name][kind] = {
                "factors": vars(fit),
                "coverage": [fit.covered(pixels) for pixels in moved],
                "coverage_where_expected": [fit.covered(pixels) for pixels in expected],
                "coverage_where_it_moved": [fit.covered(pixels) for pixels in seen],
                "width_mm": float(np.mean([2 * fit.half_width_mm(pixels).mean() for pixels in moved])),
                "score_mm": float(np.mean([_score(fit, pixels) for pixels in moved])),
            }
        found[name]["unexplained"] = vars(fit_unexplained(model, in_pose(bench.validation, crop)))
        print(name, json.dumps(found[name]), flush=True)
    return found


def sculptures(bench: Bench, seeds: Sequence[int]) -> list[dict[str, Any]]:
    """Goals in the studio by each arm: errors before and after, from scans."""
    runs = []
    for seed, goal, name in product(seeds, GOALS, ARMS):
        file = f"sculpture_{seed}_{goal.partition(':')[2]}_{name.replace(' ', '_').replace(',', '')}"
        runs.append(bench.once(file, partial(_sculpted, bench, seed, goal, name)))
    for name in ARMS:
        some = [run for run in runs if run["arm"] == name]
        left = {key: summary([run[key][1] / run[key][0] for run in some]) for key in ERRORS}
        print(name, left, np.mean([run["actions"] for run in some]), flush=True)
    return runs


def noisy_actions(bench: Bench, seeds: Sequence[int]) -> list[dict[str, Any]]:
    """Errors, as shares of those of doing nothing, of plans whose actions are shaken when they are executed."""
    return [
        bench.once(_noisy(seed, level, name), partial(_under_noise, bench, seed, level, name))
        for seed, level, name in product(seeds, (0.0, *LEVELS), PLANS)
    ]


def _noisy(seed: int, level: float, plan: str) -> str:
    """Name of a run of the part `actions`."""
    return f"actions_{seed}_{level:g}_{plan.replace(' ', '_').replace(',', '')}"


def noisy_scans(bench: Bench, seeds: Sequence[int]) -> list[dict[str, Any]]:
    """Errors, as shares of those of doing nothing, of plans on noisy scans; executed in the model without noise."""
    return [
        bench.once(f"scans_{seed}_{number}", partial(_on_noisy_scans, bench, seed, noise_m))
        for seed in seeds
        for number, noise_m in enumerate(SCAN_NOISE_M)
    ]


def _sculpted(bench: Bench, seed: int, goal: str, name: str) -> dict[str, Any]:
    arm, given = ARMS[name], bench.given
    robot, end_effector = robot_with(bench.material, TOOL, PIXELS, seed)
    goal_m = goal_on(goal, seen_m(robot.scan())[0], given.sculpting)
    weights = replace(given.sculpting.planner.weights, slope_scale_m=arm.scale_m)
    config = replace(
        given.sculpting.planner, weights=weights, disagreement_weight=arm.weight, count_unexplained=arm.unexplained
    )
    made = sculpt(
        robot, end_effector, bench.material, goal_m=goal_m, members=planned_members(bench.models[arm.model], WINDOW_M),
        grid=given.grid, config=config, execution=given.sculpting.execution, count=ACTIONS,
        session=Session("uncertainty", robot.clock_s), item=0, log=lambda *_: None,
        unexplained=_left(bench, arm.model),
    )  # fmt: skip
    plain = ClayObjective(goal_m, WINDOW_M, given.sculpting.planner.weights)
    ends = made.heights_m[[0, -1]]
    return {
        "arm": name, "seed": seed, "goal": goal, "actions": len(made.actions), "stopped": made.stopped,
        "error_3d_mm2": plain.error_3d_mm2(ends).tolist(), "visual_error": plain.visual_error(ends).tolist(),
        "value": plain.values(ends).tolist(), "lowest": float(plain.values(made.heights_m).min()),
    }  # fmt: skip


def _shaken(actions: FloatArray, level: float, reach: Reach, seed: int, draw: int) -> FloatArray:
    """Actions [N, 5] with noise of a level."""
    rng = np.random.default_rng([seed, round(1000 * level), draw])
    return reach.keep_within(actions + level * AT_ONE * rng.normal(size=actions.shape))


def _under_noise(bench: Bench, seed: int, level: float, name: str) -> dict[str, Any]:
    """A plan, and what comes of it with noise of this level, which it knows or does not."""
    height, objective, reach, config = _in_the_model(bench, seed)
    member = planned_members(bench.models["one"], WINDOW_M)[0]
    scale_m, weight = PLANS[name]
    planned = ClayObjective(objective.goal_m, WINDOW_M, replace(objective.weights, slope_scale_m=scale_m))
    base = bench.once(_noisy(seed, 0.0, "plain" if weight else name), dict) if level or weight else {}
    actions = np.array(base.get("actions", ())).reshape(-1, 5)
    if not base or (level and weight):
        shares = None
        if base:
            shares = _shares_of_noise(member, height, actions, _shaken(actions, level, reach, seed, DRAWS), planned)
        foresight = EnsembleRollout([member], planned, weight, unexplained=shares)
        actions = _planned(height, foresight, reach, config, lambda seen: seen)
    drawn, off = [], [0.0]
    for draw in range(DRAWS if level else 1):
        shaken = _shaken(actions, level, reach, seed, draw)
        drawn.append(_errors(objective, EnsembleRollout([member], objective, 0.0).roll_out(height, shaken)[0]))
        if len(actions):
            each = member.after(height, actions) - member.after(height, shaken)
            off.append(float(np.square(1e3 * each).sum(axis=(1, 2)).mean()) / bench.given.training.side_px**2)
    return {
        "seed": seed, "level": level, "plan": name, "nothing": _errors(objective, height), "actions": actions.tolist(),
        "noise_mm2": float(np.mean(off[1:] or off)),
        "errors": {key: float(np.mean([each[key] for each in drawn])) for key in drawn[0]},
    }  # fmt: skip


def _on_noisy_scans(bench: Bench, seed: int, noise_m: float) -> dict[str, Any]:
    height, objective, reach, config = _in_the_model(bench, seed)
    member = planned_members(bench.models["one"], WINDOW_M)[0]
    found: dict[str, Any] = {"seed": seed, "noise_m": noise_m, "nothing": _errors(objective, height)}
    for name in ("plain", "at a scale"):
        rng = np.random.default_rng([seed, round(1e6 * noise_m)])

        def scanned(truth: Array, rng: np.random.Generator = rng) -> Array:
            return (truth + noise_m * rng.normal(size=truth.shape)).astype(np.float32)

        weights = objective.weights
        if name != "plain":
            two = scanned(height), scanned(height)
            weights = weights_for_scans(weights, objective.goal_m, WINDOW_M, two)
        planned = ClayObjective(objective.goal_m, WINDOW_M, weights)
        foresight = EnsembleRollout([member], planned, 0.0)
        actions = _planned(height, foresight, reach, config, scanned)
        found[name] = {
            "scale_m": weights.slope_scale_m, "actions": len(actions),
            "errors": _errors(objective, foresight.roll_out(height, actions)[0]),
        }  # fmt: skip
    return found


def _planned(
    height: Array, foresight: EnsembleRollout, reach: Reach, config: SculptorConfig, scanned: Callable[[Array], Array]
) -> FloatArray:
    """Actions [N, 5] planned as a robot would, from a scan after every few; what they do is what the model says."""
    made: list[FloatArray] = []
    left = np.zeros((0, 5))
    while len(made) < ACTIONS:
        now = plan(
            scanned(height), foresight, reach, config=config, count=ACTIONS - len(made), item=(len(made),), begun=left
        ).actions
        if len(now) == 0:
            break
        made += list(now[:BATCH])
        height, left = foresight.roll_out(height, now[:BATCH]).mean(axis=0), now[BATCH:]
    return np.array(made).reshape(-1, 5)


def _in_the_model(bench: Bench, seed: int) -> tuple[Array, ClayObjective, Reach, SculptorConfig]:
    """A slab, the objective of a goal on it, and what plans may do."""
    planner = bench.given.sculpting.planner
    robot, end_effector = robot_with(bench.material, TOOL, PIXELS, seed)
    height = seen_m(robot.scan())[0]
    goal_m = goal_on(GOALS[seed % len(GOALS)], height, bench.given.sculpting)
    objective = ClayObjective(goal_m, WINDOW_M, Weights(1.0, VISUAL))
    return height, objective, reach_for(end_effector, robot.area_m, planner.edge_m), planner


def _shares_of_noise(
    member: PlannedModel, height: Array, actions: FloatArray, shaken: FloatArray, objective: ClayObjective
) -> Unexplained:
    """The shares of pushes' energies that noise in their actions makes unpredictable; each push on the first slab."""
    meant, made = member.after(height, actions), member.after(height, shaken)
    zero = objective.of_changes(objective.weights)
    return Unexplained(
        *(float(of(made - meant).sum() / of(meant - height).sum()) for of in (zero.error_3d_mm2, zero.visual_error))
    )


def _left(bench: Bench, model: str) -> Unexplained:
    chosen = bench.models[model]
    return fit_unexplained(chosen, in_pose(bench.validation, chosen.facts.crop))


def _errors(objective: ClayObjective, height: Array) -> dict[str, float]:
    scaled = ClayObjective(objective.goal_m, WINDOW_M, replace(objective.weights, slope_scale_m=0.004))
    return {
        "error_3d_mm2": float(objective.error_3d_mm2(height)),
        "visual_error": float(objective.visual_error(height)),
        "visual_error_at_4_mm": float(scaled.visual_error(height)),
    }


def _of_one_width(known: Pixels) -> Intervals:
    """Intervals of one width everywhere, that cover as much."""
    width = float(np.quantile(np.abs(known.residual_mm[known.moved]), 0.9))
    return Intervals(0.0, 1.0, 0.0, 0.0, coverage=0.9, deviations=width)


def _within_spread(pixels: Pixels) -> float:
    """Coverage of the members' spread alone, taken as a normal distribution."""
    return float((np.abs(pixels.residual_mm) <= 1.645 * np.sqrt(pixels.spread_mm2)).mean())


def _score(fit: Intervals, pixels: Pixels) -> float:
    half = fit.half_width_mm(pixels)
    return float((2 * half + 2 / (1 - fit.coverage) * np.maximum(np.abs(pixels.residual_mm) - half, 0.0)).mean())


def summary(shares: Sequence[float]) -> dict[str, float]:
    """Mean of all, and of the worst tenth (one at least)."""
    worst = np.sort(shares)[::-1][: max(round(0.1 * len(shares)), 1)]
    return {"mean": float(np.mean(shares)), "worst_tenth": float(worst.mean())}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="uncertainty", description=__doc__)
    parser.add_argument("--material", required=True)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3, 4, 5])
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--out", required=True, type=Path)
    main(parser.parse_args())
