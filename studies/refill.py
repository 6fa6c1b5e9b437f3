"""Dips by count against dips by the depletion of a load, in the studio: `python -m studies.refill`.

Four brushes: the two that are dipped, in worlds whose load runs out soon, and round brushes whose load lasts longer.
For each, equal strokes of one load show how darkness falls with the length drawn (`Depletion`). For each seed, the same
photograph is then planned and painted by both rules, without replanning. Both plans know the depletion. The base of
the stroke model is the one that the pipeline trained (``--models``).
"""

from __future__ import annotations

import argparse
import json
import tempfile
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch

from pentimento.calibration.observe import calibrate_camera
from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.colour import linear_to_srgb, to_float
from pentimento.contracts.markers import markers_around
from pentimento.contracts.plan import PlannedStroke
from pentimento.contracts.statistics import difference, item_resamples
from pentimento.control.guard import GuardedRobot
from pentimento.control.painter import as_linear, observe, paint
from pentimento.control.safety import envelope_for
from pentimento.dynamics.strokes.extended import StrokeModel
from pentimento.dynamics.strokes.mechanisms.ink_depletion import InkDepletion
from pentimento.dynamics.strokes.planned import TorchBrush, depletion_of
from pentimento.dynamics.strokes.traj2stroke import read_parameters
from pentimento.planning.strokes.brush import Span, StrokeTiming
from pentimento.planning.strokes.config import PlannerConfig, no_log
from pentimento.planning.strokes.planner import plan
from pentimento.planning.strokes.scene import scene_with
from pentimento.planning.strokes.target import fit_to_canvas, load_photograph
from pentimento.robots.motion import timed_path
from pentimento.robots.refill import Depletion, with_dips
from pentimento.robots.tools import Tool, load_tool
from pentimento.robots.virtual import VirtualRobot
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import World, load_world
from pipelines._config import load_section
from pipelines._imports import ROOT
from pipelines._io import single_threaded
from pipelines._params import read_yaml

SHEET_M = (0.1, 0.1)
PHOTOGRAPH = "chelsea"
STROKES = 30
ROW, ROW_LENGTH_M, ROW_APART_M, ROW_SHEET_M = 8, 0.05, 0.02, (0.1, 0.16)
"""Strokes that show the depletion: number, length, distance, and their sheet."""
PIXELS_PER_M = 1000.0
SEEN = 0.2
"""Share of the first stroke's darkness below which a load counts as used up; those strokes are not fitted."""
CYAN = np.array([0.1, 0.35, 0.5])
SMALL = {
    "iterations_free": 12, "iterations_palette": 6, "rounds": 1, "sizes": [0.8, 0.0], "candidates": 3,
    "pixels_per_m": 400, "sweeps": 1, "relocate_every": 0, "min_gain_per_stroke": 0.0,
    "palette": {"source": "plan", "size": 3, "picture": None, "colors_srgb": None},
}  # fmt: skip
"""Of the planner `small_colour`: fewer iterations and paints, on a smaller sheet."""


@dataclass(frozen=True)
class Case:
    """A brush in a world."""

    tool: str
    strength: float
    """Of the world's ink_depletion."""
    most: int
    """`max_strokes_per_dip` of the rule by depletion."""


@dataclass(frozen=True)
class Config:
    """How plans are made."""

    planner: PlannerConfig


CASES = {
    "round brush, runs out soon": Case("round_brush", 3.0, 4),
    "flat brush, runs out soon": Case("flat_brush", 3.0, 4),
    "round brush, runs out slowly": Case("round_brush", 0.2, 12),
    "round brush, lasts": Case("round_brush", 0.02, 12),
}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.refill", description=__doc__)
    parser.add_argument("--models", type=Path, default=Path("models"), help="folder of stroke_<tool>_base")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--out", type=Path, default=Path("data/studies/refill.json"))
    args = parser.parse_args()
    single_threaded()
    results: dict[str, Any] = json.loads(args.out.read_text(encoding="utf-8")) if args.out.exists() else {}
    for seed in range(1, args.seeds + 1):
        for name, case in CASES.items():
            if f"{name}, {seed}" not in results:
                base = args.models / f"stroke_{case.tool}_base" / "weights"
                results[f"{name}, {seed}"] = both(case, base, seed)
                atomic_write(args.out, json.dumps(results, indent=1).encode())
                print(name, seed, results[f"{name}, {seed}"], flush=True)
    print(table(results))


def both(case: Case, base: Path, seed: int) -> dict[str, Any]:
    """Dips and errors by both rules, and the loss of the load per metre."""
    world, tool = world_of(case, SHEET_M), load_tool(case.tool)
    by_count = replace(tool, max_fade=None)
    by_depletion = replace(tool, max_strokes_per_dip=case.most)
    depletion = depletion_on(case)
    model = StrokeModel(
        read_parameters(base / "parameters.json"),
        (InkDepletion(torch.tensor([depletion.loss, 0.0]), {"column": 0.0, "since": 1.0}),),
        {"ink_since_reload_m": Span(0.0, 0.1, 1.0)},
        StrokeTiming(0.0, 0.0),
    )
    return {
        "loss_per_m": depletion.loss,
        "count": painted(world, by_count, model, seed),
        "depletion": painted(world, by_depletion, model, seed),
    }


@cache
def depletion_on(case: Case) -> Depletion:
    """The loss of darkness of equal strokes of one load, one above the other, by least squares on its logarithm."""
    tool = load_tool(case.tool)
    robot = VirtualRobot(Studio(world_of(case, ROW_SHEET_M), 0))
    calibration = calibrate_camera(robot.photo(), markers_around(robot.canvas_size_m))
    before = as_linear(observe(robot, calibration, PIXELS_PER_M))
    robot.load_palette(CYAN[None])
    robot.dip(0)
    for number in range(ROW):
        places = np.zeros((16, 4))
        places[:, 0] = np.linspace(ROW_SHEET_M[0] - ROW_LENGTH_M, ROW_SHEET_M[0] + ROW_LENGTH_M, 16) / 2
        places[:, 1], places[:, 2] = ROW_APART_M * (number + 0.5), -np.mean(tool.press_range_m)
        robot.move(timed_path(places, tool.speed_m_s))
    gone = (before - as_linear(observe(robot, calibration, PIXELS_PER_M))).sum(axis=(1, 2))[::-1]
    dark = gone.reshape(ROW, -1).sum(axis=1)
    marks = int(np.argmax(np.append(dark < SEEN * dark[0], True)))
    middle_m = ROW_LENGTH_M * (np.arange(marks) + 0.5)
    return Depletion("ink_since_reload_m", -float(np.polyfit(middle_m, np.log(dark[:marks]), 1)[0]))


def world_of(case: Case, sheet_m: tuple[float, float]) -> World:
    """The case's world, with a sheet of this size."""
    world = load_world(case.tool)
    effects = replace(world.effects, ink_depletion=case.strength)
    return replace(world, effects=effects, paper=replace(world.paper, size_m=sheet_m))


def painted(world: World, tool: Tool, model: StrokeModel, seed: int) -> dict[str, float]:
    """Plan and paint: dips, and mean squared differences of the painting from plan and target, sRGB in [0, 1]."""
    config = planner(seed)
    virtual = VirtualRobot(Studio(world, seed))
    robot = GuardedRobot(virtual, envelope_for(tool, virtual.canvas_size_m))
    calibration = calibrate_camera(robot.photo(), markers_around(robot.canvas_size_m))
    blank = observe(robot, calibration, config.pixels_per_m)
    target = fit_to_canvas(load_photograph(PHOTOGRAPH), blank.shape[:2]).astype(np.float32)
    scene = scene_with(TorchBrush(model, tool, config.path_points), tool, robot.canvas_size_m, target)
    strokes, palette = plan(as_linear(blank), scene, STROKES, config, no_log)
    painting = paint(
        robot, scene, strokes, palette_srgb=palette, replan_every=STROKES, replan=False, config=config, log=no_log
    )
    executed: list[PlannedStroke] = with_dips(painting.executed, tool, scene.start.memory, depletion_of(model))
    photo = to_float(painting.photos[-1])
    return {
        "strokes": len(executed),
        "dips": sum(stroke.dip for stroke in executed),
        "from_plan": float(np.square(photo - to_float(painting.predicted)).mean()),
        "from_target": float(np.square(photo - linear_to_srgb(target)).mean()),
    }


def planner(seed: int) -> PlannerConfig:
    """The small planner of this study."""
    params = read_yaml(ROOT / "params.yaml")
    small = {"planner": {"preset": "planners.small_colour", **SMALL, "seed": seed}}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "params.yaml"
        path.write_text(json.dumps({"planners": params["planners"], "refill": small}), encoding="utf-8")
        return load_section(path, "refill", Config).planner


def table(results: dict[str, Any]) -> str:
    """Means over seeds, and the mean of the paired differences with its 95% interval, as Markdown."""
    lines = [
        "| brush | darkness lost per metre | dips by count | by depletion | painting from plan, by count → by "
        "depletion | painting from target |",
        "|---|---|---|---|---|---|",
    ]
    for name in CASES:
        runs = [run for key, run in results.items() if key.rsplit(",", 1)[0] == name]
        if runs:
            loss = np.mean([run["loss_per_m"] for run in runs])
            dips = [np.mean([run[rule]["dips"] for run in runs]) for rule in ("count", "depletion")]
            errors = " | ".join(_change(runs, key) for key in ("from_plan", "from_target"))
            lines.append(f"| {name} | {loss:.2f} | {dips[0]:.1f} | {dips[1]:.1f} | {errors} |")
    return "\n".join(lines)


def _change(runs: list[dict[str, Any]], key: str) -> str:
    one, other = (np.array([run[rule][key] for run in runs]) for rule in ("count", "depletion"))
    change = difference(other, one, item_resamples(len(runs), 0))
    assert change is not None
    return f"{one.mean():.4f} → {other.mean():.4f} ({change.low:+.4f} to {change.high:+.4f})"


if __name__ == "__main__":
    main()
