"""How far paintings end from their plans, by the model that plans: `python -m studies.plan_execution --out DIR`.

For each tool and seed, collect_strokes, train_stroke_dynamics and diagnose_gap run in a folder of their own. The same
photograph is then planned with three models, painted in the studio without replanning, and compared with the plan's
prediction. A seed sets the studio, the collection, training, splits and the diagnosis. Each result is kept in DIR and
not made again.
"""

import argparse
import itertools
import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pentimento.calibration.observe import calibrate_camera
from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.colour import to_float
from pentimento.contracts.markers import markers_around
from pentimento.control.guard import GuardedRobot
from pentimento.control.painter import as_linear, observe, paint
from pentimento.control.safety import envelope_for
from pentimento.dynamics.strokes.extended import StrokeModel, base_model, read_stroke_model
from pentimento.dynamics.strokes.planned import TorchBrush
from pentimento.dynamics.strokes.traj2stroke import read_parameters
from pentimento.planning.strokes.config import no_log
from pentimento.planning.strokes.planner import plan
from pentimento.planning.strokes.scene import scene_with
from pentimento.planning.strokes.target import fit_to_canvas, fit_to_ink, load_photograph
from pentimento.robots.tools import load_tool
from pentimento.robots.virtual import VirtualRobot
from pentimento.semantics.style import style_of
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import load_world
from pipelines._config import load_section
from pipelines._imports import ROOT
from pipelines._io import single_threaded
from pipelines._params import read_yaml
from pipelines.paint import Paint

PRESETS = {"marker": "planners.pen", "round_brush": "planners.colour", "flat_brush": "planners.colour"}
STROKES = 120
FEWER = {"iterations_free": 60, "iterations_palette": 40}
"""Of the planner: a third of the pipeline's."""
MODELS = {
    "base": "Traj2Stroke",
    "causes": "with the causes that the diagnosis found",
    "corrected": "and with the learned correction, as deployed",
}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.plan_execution", description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--out", type=Path, default=Path("data/studies/plan_execution"))
    args = parser.parse_args()
    single_threaded()
    for seed, tool in itertools.product(range(1, args.seeds + 1), PRESETS):
        file = args.out / f"{tool}_{seed}.json"
        if not file.exists():
            atomic_write(file, json.dumps(errors_of(tool, seed, args.out / f"{tool}_{seed}")).encode())
        print(file.stem, file.read_text(), flush=True)
    print(table(args.out))


def errors_of(tool_name: str, seed: int, work: Path) -> dict[str, Any]:
    """Mean squared difference between plan and painting, sRGB in [0, 1], by the model; the causes that it has."""
    work.mkdir(parents=True, exist_ok=True)
    (work / "params.yaml").write_text(json.dumps(params_of(tool_name, seed)), encoding="utf-8")  # JSON is YAML
    base, found = work / "base", work / "extended"
    stages: dict[str, list[str | Path]] = {
        "collect_strokes": ["--out", work / "strokes"],
        "train_stroke_dynamics": ["--strokes", work / "strokes", "--out", base],
        "diagnose_gap": ["--strokes", work / "strokes", "--base", base, "--gap", work / "gap", "--out", found],
    }
    for stage, options in stages.items():
        command = [sys.executable, "-m", f"pipelines.{stage}", "--tool", tool_name, *options]
        subprocess.run(command, cwd=work, check=True, stderr=subprocess.DEVNULL)
    extended = read_stroke_model(found)
    models = {
        "base": base_model(read_parameters(base / "parameters.json")),
        "causes": replace(extended, correction=None),
        "corrected": extended,
    }
    config = load_section(work / "params.yaml", "paint", Paint)
    return {
        "causes": [mechanism.cause for mechanism in extended.mechanisms],
        "corrected": extended.correction is not None,
        "error": {name: execution_error(model, config) for name, model in models.items()},
    }


def params_of(tool: str, seed: int) -> dict[str, Any]:
    """params.yaml with this seed everywhere, and one painting."""
    params: dict[str, Any] = read_yaml(ROOT / "params.yaml")
    params["collect_strokes"]["collection"]["seed"] = seed
    params["strokes"]["training"]["seed"] = seed
    params["diagnose_gap"]["seed"] = seed
    darkest = 0.0 if load_tool(tool).color_srgb is None else 0.35
    painting = {"photograph": "chelsea", "tool": tool, "world": tool, "darkest": darkest}
    painting["planner"] = {"preset": PRESETS[tool], **FEWER}
    params["paint"] |= {"strokes": STROKES, "seed": 100 + seed, "settings": {"study": painting}}
    return params


def execution_error(model: StrokeModel, config: Paint) -> float:
    """Of a painting that this model plans."""
    setting = config.settings["study"]
    tool, planner = load_tool(setting.tool), setting.planner
    virtual = VirtualRobot(Studio(load_world(setting.world), config.seed))
    robot = GuardedRobot(virtual, envelope_for(tool, virtual.canvas_size_m))
    calibration = calibrate_camera(robot.photo(), markers_around(robot.canvas_size_m))
    blank = observe(robot, calibration, planner.pixels_per_m)
    photograph = fit_to_canvas(load_photograph(setting.photograph), blank.shape[:2])
    target = photograph if tool.color_srgb is None else fit_to_ink(photograph, setting.darkest)
    brush = TorchBrush(model, tool, planner.path_points)
    scene = scene_with(brush, tool, robot.canvas_size_m, target.astype(np.float32), style_of(planner))
    strokes, palette = plan(as_linear(blank), scene, config.strokes, planner, no_log)
    painting = paint(
        robot, scene, strokes, palette_srgb=palette, replan_every=config.replan_every, replan=False, config=planner,
        log=no_log,
    )  # fmt: skip
    return float(np.square(to_float(painting.predicted) - to_float(painting.photos[-1])).mean())


def table(out: Path) -> str:
    """Means over seeds, and each seed's ratio to the base, as Markdown."""
    lines = ["| tool | model | error | to the base, by seed | better than the base |", "|---|---|---|---|---|"]
    for tool in PRESETS:
        runs = [json.loads(file.read_text())["error"] for file in sorted(out.glob(f"{tool}_*.json"))]
        for name, words in MODELS.items() if runs else ():
            lines.append(f"| {tool} | {words} | {_row([run[name] for run in runs], [run['base'] for run in runs])} |")
    return "\n".join(lines)


def _row(errors: Sequence[float], of_base: Sequence[float]) -> str:
    ratios = [error / base for error, base in zip(errors, of_base, strict=True)]
    better = f"{sum(ratio < 1 for ratio in ratios)} of {len(ratios)}"
    return f"{np.mean(errors):.4f} | {', '.join(f'{ratio:.2f}' for ratio in ratios)} | {better}"


if __name__ == "__main__":
    main()
