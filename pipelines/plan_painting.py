"""Plan a painting with the model of a tool whose strokes were recorded; nothing is executed."""

import argparse
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from pentimento.contracts.colour import linear_to_srgb, to_uint8
from pentimento.contracts.covariates import fresh_memory
from pentimento.contracts.images import write_png
from pentimento.contracts.plan import Plan, PlanHeader, write_plan
from pentimento.contracts.ranges import at_least
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.control.painter import (
    PaintContext,
    as_linear,
    as_picture,
    commands,
    first_plan,
    objective_value,
    predict_canvas,
)
from pentimento.control.safety import envelope_for
from pentimento.dynamics.strokes.extended import read_stroke_model
from pentimento.dynamics.strokes.own_frame import for_the_canvas
from pentimento.dynamics.strokes.planned import TorchBrush
from pentimento.planning.strokes.config import PlannerConfig
from pentimento.planning.strokes.memory import Start, beyond_fit, planned_covariates
from pentimento.planning.strokes.target import fit_to_canvas, fit_to_ink, load_photograph
from pentimento.robots.refill import too_long, with_dips
from pentimento.robots.tools import load_tool
from pipelines._config import entry_of, load_section
from pipelines._io import output_folder, single_threaded, stage_main, write_json
from pipelines._tracking import tracked_run


@dataclass(frozen=True)
class PlannedTool:
    """One tool, and the painting that is planned with it."""

    file: str
    """The tool file: a shipped tool's name, or a TOML file."""
    photograph: str
    """A file, or the name of a photograph that scikit-image ships."""
    darkest: float
    """For a tool with its own ink: the lightness (0 to 1) of the target's darkest tone."""
    canvas_m: tuple[float, float]
    """Width and height of a white sheet."""
    strokes: int
    """At most; strokes that would not help are dropped."""
    planner: PlannerConfig

    def __post_init__(self) -> None:
        at_least(self, 0, "darkest")
        if self.darkest >= 1:
            raise ValueError(f"darkest is {self.darkest}; it must be below 1, or the target is all white.")
        if min(self.canvas_m) <= 0:
            raise ValueError(f"canvas_m is {list(self.canvas_m)}; both sides must be above 0.")
        at_least(self, 1, "strokes")


@dataclass(frozen=True)
class PlanPainting:
    """Section `plan_painting` of params.yaml."""

    tools: dict[str, PlannedTool]


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: target.png, plan.png, plan.jsonl, curve.json, warnings.json, metrics.json."""
    config = load_section(Path("params.yaml"), "plan_painting", PlanPainting)
    setting = entry_of(config.tools, arguments.tool, "plan_painting.tools")
    single_threaded()
    inputs = {"strokes": arguments.strokes, "stroke_model": arguments.model}
    with (
        tracked_run("plan_painting", arguments.tool, asdict(setting), inputs) as run,
        output_folder(arguments.out) as out,
    ):
        tool, planner = load_tool(setting.file), setting.planner
        model, recorded = read_stroke_model(arguments.model), read_table(arguments.strokes, CONTRACT).table
        if "frame" in recorded.column_names and "stroke" in recorded.column("frame").to_pylist():
            model = for_the_canvas(model)
        brush = TorchBrush(model, tool, planner.path_points)
        context = PaintContext(tool, brush, setting.canvas_m, planner)
        start = Start(fresh_memory(setting.canvas_m, tool.nominal_width_m), clock_s=0.0, made=0)
        width, height = (round(side * planner.pixels_per_m) for side in setting.canvas_m)
        blank = np.full((height, width, 3), 255, np.uint8)
        photograph = fit_to_canvas(load_photograph(setting.photograph), (height, width))
        target = photograph if tool.color_srgb is None else fit_to_ink(photograph, setting.darkest)
        goal, losses = to_uint8(linear_to_srgb(target)), list[float]()

        def log(name: str, value: float, step: int) -> None:
            run.log(name, value, step)
            losses.append(value)

        strokes, palette = first_plan(context, blank, goal, count=setting.strokes, start=start, log=log)
        painted = predict_canvas(context, strokes, blank, start)
        planned = commands(context, strokes)
        known = planned_covariates(strokes, tool, brush, start, names=brush.fitted) if planned else {}
        planned = with_dips(planned, tool, start.memory, brush.depletion)
        warnings = beyond_fit(known, brush.fitted)
        if long := too_long(planned, tool, brush.depletion):
            warnings.append(long)
        for sentence in warnings:
            print(f"plan_painting: {sentence}", file=sys.stderr)
        header = PlanHeader(tool.name, palette, setting.canvas_m, envelope_for(tool, setting.canvas_m).id)
        write_png(out / "target.png", goal)
        write_png(out / "plan.png", as_picture(painted))
        write_plan(out / "plan.jsonl", Plan(header, tuple(planned)))
        write_json(out / "curve.json", {"iteration": list(range(len(losses))), "objective": losses})
        write_json(out / "warnings.json", warnings)
        images = {"blank": as_linear(blank), "plan": painted}
        metrics = {
            "strokes": len(planned),
            "dips": sum(stroke.dip for stroke in planned),
            "error": {name: objective_value(context, image, goal, start) for name, image in images.items()},
        }
        write_json(out / "metrics.json", metrics)
        run.log_metrics(metrics)
        run.log_picture(out / "plan.png")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="plan_painting", description=__doc__)
    parser.add_argument("--tool", required=True)
    parser.add_argument("--strokes", required=True, type=Path, help="the table that the model was fitted to")
    parser.add_argument("--model", required=True, type=Path, help="the extended stroke model of diagnose_gap")
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
