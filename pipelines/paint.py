"""Paint a photograph: plan, execute in the studio with and without replanning, and measure the errors."""

import argparse
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.calibration.observe import calibrate_camera
from pentimento.contracts.colour import linear_to_srgb, to_float, to_uint8
from pentimento.contracts.covariates import fresh_memory
from pentimento.contracts.images import write_png
from pentimento.contracts.markers import markers_around
from pentimento.contracts.plan import Plan, PlanHeader, PlannedStroke, write_plan
from pentimento.contracts.ranges import at_least
from pentimento.control.execute import Session, execute
from pentimento.control.guard import GuardedRobot
from pentimento.control.painter import Image, Painting, as_linear, observe, paint, predict
from pentimento.control.safety import envelope_for
from pentimento.dynamics.strokes.extended import StrokeModel, base_model, read_stroke_model
from pentimento.dynamics.strokes.planned import TorchBrush
from pentimento.dynamics.strokes.traj2stroke import read_parameters
from pentimento.planning.objectives import PrintObjective
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.config import PlannerConfig, no_log
from pentimento.planning.strokes.memory import beyond_fit, planned_covariates
from pentimento.planning.strokes.planner import plan
from pentimento.planning.strokes.scene import Scene, scene_with
from pentimento.planning.strokes.target import fit_to_canvas, fit_to_ink, load_photograph
from pentimento.robots.driver import Robot
from pentimento.robots.refill import too_long, with_dips
from pentimento.robots.svg import SvgPlotter
from pentimento.robots.tools import Tool, load_tool
from pentimento.robots.virtual import VirtualRobot
from pentimento.semantics.style import style_of
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import load_world
from pipelines._config import entry_of, load_section, require_model
from pipelines._io import output_folder, single_threaded, stage_main, write_json
from pipelines._tracking import tracked_run

FloatArray = NDArray[np.float64]
Light = NDArray[np.float32]


@dataclass(frozen=True)
class Setting:
    """One painting."""

    photograph: str
    """A file, or the name of a photograph that scikit-image ships."""
    tool: str
    world: str
    """The studio's."""
    darkest: float
    """For a tool with its own ink: the lightness (0 to 1) of the target's darkest tone."""
    planner: PlannerConfig

    def __post_init__(self) -> None:
        at_least(self, 0, "darkest")
        if self.darkest >= 1:
            raise ValueError(f"darkest is {self.darkest}; it must be below 1, or the target is all white.")


@dataclass(frozen=True)
class Paint:
    """Section `paint` of params.yaml."""

    strokes: int
    """In each painting."""
    replan_every: int
    """Strokes between two photographs (thesis 4.3.5: 20)."""
    seed: int
    """Of the studio."""
    settings: dict[str, Setting]

    def __post_init__(self) -> None:
        at_least(self, 1, "strokes", "replan_every")
        at_least(self, 0, "seed")


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: pictures, plans, curves and metrics.json of one setting."""
    config = load_section(Path("params.yaml"), "paint", Paint)
    setting = entry_of(config.settings, arguments.setting, "paint.settings")
    require_model(f"paint.settings.{arguments.setting}.tool", setting.tool, arguments.tools)
    weights, base_weights = (arguments.models / f"stroke_{setting.tool}{kind}" / "weights" for kind in ("", "_base"))
    single_threaded()
    params = {"strokes": config.strokes, "replan_every": config.replan_every, "seed": config.seed} | asdict(setting)
    with (
        tracked_run("paint", arguments.setting, params, {"stroke_model": weights, "stroke_base": base_weights}) as run,
        output_folder(arguments.out) as out,
    ):
        tool = load_tool(setting.tool)
        robot = _robot(tool, setting, config.seed)
        calibration = calibrate_camera(robot.photo(), markers_around(robot.canvas_size_m))
        blank = observe(robot, calibration, setting.planner.pixels_per_m)
        photograph = fit_to_canvas(load_photograph(setting.photograph), blank.shape[:2])
        target = photograph if tool.color_srgb is None else fit_to_ink(photograph, setting.darkest)
        models = _models(weights, base_weights)
        scenes = _scenes(models, tool, setting, canvas_size_m=robot.canvas_size_m, target=target)
        scene, losses = scenes["extended"], list[float]()

        def log(name: str, value: float, step: int) -> None:
            run.log(name, value, step)
            losses.append(value)

        strokes, palette = plan(as_linear(blank), scene, config.strokes, setting.planner, log)
        for sentence in _warnings(strokes, scene):
            print(f"paint: {sentence}", file=sys.stderr)
        new_robot = partial(_robot, tool, setting, config.seed)
        paintings = {
            kind: paint(
                new_robot(), scene, strokes, palette_srgb=palette, replan_every=config.replan_every,
                replan=kind == "with", config=setting.planner, log=run.log_under(kind),
            )
            for kind in ("without", "with")
        }  # fmt: skip
        simpler = {name: np.clip(predict(strokes, blank, scenes[name]), 0.0, 1.0) for name in ("base", "polyline")}
        write_png(out / "photograph.png", to_uint8(linear_to_srgb(photograph)))
        write_png(out / "target.png", to_uint8(linear_to_srgb(target)))
        write_png(out / "polyline.png", to_uint8(simpler["polyline"]))
        planned = with_dips(
            strokes.planned(tool, setting.planner.path_points), tool, scene.start.memory, scene.brush.depletion
        )
        _write_paintings(out, tool, robot.canvas_size_m, planned=planned, palette=palette, paintings=paintings)
        executed = [min(i * config.replan_every, len(planned)) for i in range(len(paintings["with"].deviation))]
        deviation = {kind: painting.deviation for kind, painting in paintings.items()}
        write_json(out / "deviation.json", {"strokes": executed} | deviation)
        write_json(out / "curve.json", {"iteration": list(range(len(losses))), "objective": losses})
        write_json(out / "palette.json", palette)
        metrics = _metrics(scene, blank, simpler, paintings, setting.planner)
        metrics |= _execution_errors(
            metrics, scenes, models["extended"], new_robot=new_robot, blank=blank, config=config, setting=setting
        )
        write_json(out / "metrics.json", metrics)
        run.log_metrics(metrics)
        for name in ("plan.png", "painting_with.png", "painting_without.png"):
            run.log_picture(out / name)


def _models(weights: Path, base_weights: Path) -> dict[str, StrokeModel]:
    """Return the extended model, the base and the polyline."""
    return {
        "extended": read_stroke_model(weights),
        "base": base_model(read_parameters(base_weights / "parameters.json")),
        "polyline": base_model(read_parameters(base_weights / "polyline.json")),
    }


def _scenes(
    models: dict[str, StrokeModel],
    tool: Tool,
    setting: Setting,
    *,
    canvas_size_m: tuple[float, float],
    target: FloatArray,
) -> dict[str, Scene]:
    """Return the scene of each model, with a blank canvas; ``target`` is linear light."""
    style, light = style_of(setting.planner), target.astype(np.float32)
    brushes = {name: TorchBrush(model, tool, setting.planner.path_points) for name, model in models.items()}
    return {name: scene_with(brush, tool, canvas_size_m, light, style) for name, brush in brushes.items()}


def _write_paintings(
    out: Path,
    tool: Tool,
    canvas_size_m: tuple[float, float],
    *,
    planned: list[PlannedStroke],
    palette: FloatArray,
    paintings: dict[str, Painting],
) -> None:
    """Write the plan, both paintings with their executed strokes, and the photographs taken while painting."""
    header = PlanHeader(tool.name, palette, canvas_size_m, envelope_for(tool, canvas_size_m).id)
    write_png(out / "plan.png", paintings["without"].predicted)
    write_plan(out / "plan.jsonl", Plan(header, tuple(planned)))
    _plot(out / "plan.svg", tool, planned, palette, canvas_size_m)
    for kind, painting in paintings.items():
        write_png(out / f"painting_{kind}.png", painting.photos[-1])
        write_plan(out / f"executed_{kind}.jsonl", Plan(header, tuple(painting.executed)))
    (out / "frames").mkdir()
    for number, photo in enumerate(paintings["with"].photos):
        write_png(out / "frames" / f"{number:03d}.png", photo)


def _robot(tool: Tool, setting: Setting, seed: int) -> Robot:
    """Return a new robot with the same blank sheet."""
    robot = VirtualRobot(Studio(load_world(setting.world), seed))
    return GuardedRobot(robot, envelope_for(tool, robot.canvas_size_m))


def _warnings(strokes: Strokes, scene: Scene) -> list[str]:
    """Return warnings where a plan leaves the range of the data that the model was fitted to, and on long strokes."""
    tool, brush = scene.tool, scene.brush
    known = planned_covariates(strokes, tool, brush, scene.start, names=brush.fitted)
    long = too_long(strokes.planned(tool, brush.path_points), tool, brush.depletion)
    return [*beyond_fit(known, brush.fitted), *([long] if long else [])]


def _plot(
    path: Path,
    tool: Tool,
    strokes: list[PlannedStroke],
    palette: FloatArray,
    canvas_size_m: tuple[float, float],
) -> None:
    """Write the plan as a drawing for a pen plotter, through the same safety envelope."""
    plotter = SvgPlotter(path, canvas_size_m)
    execute(
        GuardedRobot(plotter, envelope_for(tool, canvas_size_m)), tool, strokes, palette_srgb=palette,
        memory=fresh_memory(canvas_size_m, tool.nominal_width_m), session=Session("plot", 0.0),
    )  # fmt: skip
    plotter.close()


def _metrics(
    scene: Scene, blank: Image, simpler: dict[str, Light], paintings: dict[str, Painting], config: PlannerConfig
) -> dict[str, Any]:
    """Return errors against the target and against the plan; mean squared differences in sRGB in [0, 1]."""
    target = linear_to_srgb(scene.target.astype(np.float64))
    objective = PrintObjective(scene.target, config.distances_px)
    final = {kind: painting.photos[-1] for kind, painting in paintings.items()}

    def error(image: Image) -> float:
        return objective(as_linear(image))[0]

    def mse(one: NDArray[np.floating], other: NDArray[np.floating]) -> float:
        return float(np.square(one - other).mean())

    real = to_float(final["without"])
    sim2real = {
        "model": mse(to_float(paintings["without"].predicted), real),
        "base": mse(simpler["base"], real),
        "polyline": mse(simpler["polyline"], real),
        "blank": mse(to_float(blank), real),
    }
    errors = {
        "blank": error(blank),
        "plan": error(paintings["without"].predicted),
        "without_replanning": error(final["without"]),
        "with_replanning": error(final["with"]),
    }
    return {
        "strokes": len(paintings["with"].executed),
        "error": errors,
        "replanning_lowers_error_by": 1 - errors["with_replanning"] / errors["without_replanning"],
        "pixel_mse": {
            "without_replanning": mse(to_float(final["without"]), target),
            "with_replanning": mse(to_float(final["with"]), target),
        },
        "sim2real_mse": sim2real,
        "sim2real_factor": sim2real["polyline"] / sim2real["model"],
        "deviation": {kind: painting.deviation[-1] for kind, painting in paintings.items()},
    }


def _execution_errors(
    metrics: dict[str, Any],
    scenes: dict[str, Scene],
    extended: StrokeModel,
    *,
    new_robot: Callable[[], Robot],
    blank: Image,
    config: Paint,
    setting: Setting,
) -> dict[str, Any]:
    """Return the error of a plan's prediction without replanning, for plans with the base and the extended model.

    Mean squared difference, sRGB in [0, 1]. Where nothing extends the base, both plans are the same.
    """
    error = {"extended": metrics["sim2real_mse"]["model"]}
    if extended.mechanisms:
        strokes, palette = plan(as_linear(blank), scenes["base"], config.strokes, setting.planner, no_log)
        painting = paint(
            new_robot(), scenes["base"], strokes, palette_srgb=palette, replan_every=config.replan_every, replan=False,
            config=setting.planner, log=no_log,
        )  # fmt: skip
        difference = to_float(painting.predicted) - to_float(painting.photos[-1])
        error["base"] = float(np.square(difference).mean())
    else:
        error["base"] = error["extended"]
    return {
        "plan_execution_error_base": error["base"],
        "plan_execution_error_extended": error["extended"],
        "plan_execution_factor": error["base"] / error["extended"],
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="paint", description=__doc__)
    parser.add_argument("--setting", required=True)
    parser.add_argument("--models", required=True, type=Path, help="folder of stroke_<tool> and stroke_<tool>_base")
    parser.add_argument("--tools", required=True, nargs="+", help="whose models are there")
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
