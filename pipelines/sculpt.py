"""Sculpt goals one after another in the same clay: plan, push, look, replan, and measure the result."""

import argparse
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError
from pentimento.contracts.frames import image_shape
from pentimento.contracts.height_maps import encode_height_png
from pentimento.contracts.images import write_png
from pentimento.contracts.pushes import CONTRACT
from pentimento.contracts.ranges import above_zero, at_least
from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.tables import write_shards
from pentimento.control.execute import Session
from pentimento.control.execute_push import HEIGHT_PER_UNIT_M
from pentimento.control.place_safety import place_envelope_for
from pentimento.control.placing import Placer
from pentimento.control.push_safety import GuardedSculptingRobot, push_envelope_for
from pentimento.control.sculpting_settings import SculptingSettings
from pentimento.control.sculptor import Sculpture, reach_for, sculpt, seen_m
from pentimento.dynamics.pushes.push_model import planned_members, read_push_model
from pentimento.goals3d.evaluation import goal_errors
from pentimento.goals3d.shading import photograph
from pentimento.goals3d.sources import Up, relief_of
from pentimento.planning.objectives import ClayObjective
from pentimento.planning.pushes.analytic.correction import corrected
from pentimento.planning.pushes.goal import GoalFit, fit_goal, raised_goal
from pentimento.planning.pushes.memory import PushMemory
from pentimento.planning.pushes.places import FILE as PLACES
from pentimento.planning.pushes.places import read_place_model
from pentimento.planning.pushes.plan import PushPlan
from pentimento.planning.pushes.rollout import EnsembleRollout, PushModel
from pentimento.planning.pushes.scales import plan_for_scan
from pentimento.report.figures import time_lapse
from pentimento.robots.driver import SculptingRobot
from pentimento.robots.tools import EndEffector, load_end_effector, load_feeder
from pentimento.robots.virtual import virtual_sculpting_robot
from pentimento.semantics.letter_classifier import LetterClassifier, classify_sculpture
from pipelines._config import entry_of, load_section
from pipelines._io import output_folder, single_threaded, stage_main, write_json
from pipelines._tracking import tracked_run

Array = NDArray[np.float32]

_PICTURE_PX = 384
"""Side of a picture, unless the scan is finer."""
_FRAME_PX = 256
"""The same of a picture of the time-lapse."""


@dataclass(frozen=True)
class Wanted:
    """One goal."""

    source: str
    """letter:<text>, shape:<name>, or a file; see `goals3d.sources`."""
    depth_m: float
    """Depth of its lowest point below the clay's mean height; a later goal must be deeper than an earlier one."""
    up: Up | None = None
    """Of a mesh: its axis that points up. Null is z, but an OBJ needs it."""
    raised_m: float = 0.0
    """Height of its highest point above the clay's mean height. Above 0 it stands on the surface, which needs a feeder,
    and `depth_m` does not count."""


@dataclass(frozen=True)
class Setting:
    """One sculpture."""

    world: str
    """The studio's."""
    end_effector: str
    goals: tuple[Wanted, ...]
    """In this order, in the same clay."""
    sculpting: SculptingSettings
    """Goals, plans and execution; each goal has its own depth in place of that of `fit`."""
    depth_model: str | None
    """For pictures: folder of a depth model of transformers, or null for a plain relief."""


@dataclass(frozen=True)
class Sculpt:
    """Section `sculpt` of params.yaml."""

    scan_pixels: int
    """Of a scan, along the slab's longer side."""
    classifier_letters: str
    """Classes of the letter classifier, which is applied only to goals among them."""
    classifier_examples: int
    """Renderings of each, to train it on."""
    frame_ms: int
    """Duration of each picture in the time-lapse."""
    seed: int
    """Of the studio."""
    settings: dict[str, Setting]

    def __post_init__(self) -> None:
        at_least(self, 1, "classifier_examples")
        at_least(self, 2, "scan_pixels")
        above_zero(self, "frame_ms")
        at_least(self, 0, "seed")
        if len(set(self.classifier_letters)) < 2:
            raise ValueError(
                f"classifier_letters is {self.classifier_letters!r}; a classifier needs at least two letters."
            )


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: the pushes table, plans, height maps, pictures and metrics.json of one material."""
    config = load_section(Path("params.yaml"), "sculpt", Sculpt)
    setting = entry_of(config.settings, arguments.material, "sculpt.settings")
    sculpting = setting.sculpting
    single_threaded()
    with (
        tracked_run("sculpt", arguments.material, asdict(config), {"push_model": arguments.model}) as run,
        output_folder(arguments.out) as out,
    ):
        end_effector = load_end_effector(setting.end_effector)
        placer = _placer(setting, arguments.model)
        robot = _robot(setting, end_effector, placer, config)
        window_m = np.array([0.0, 0.0, *robot.area_m])
        model = read_push_model(arguments.model)
        if model.facts.contexts[0] != (arguments.material, end_effector.name):
            raise ConfigError(
                f"{arguments.model} was trained on {' with '.join(model.facts.contexts[0])}, and params.yaml: "
                f"sculpt.settings asks for {arguments.material} with {end_effector.name}; train it on that."
            )
        members = tuple(corrected(member, arguments.model) for member in planned_members(model, window_m))
        grid = image_shape(window_m, model.facts.crop.pixels_per_m)
        reader = LetterClassifier(config.classifier_letters, config.classifier_examples, config.seed)
        session = Session(f"sculpture-{arguments.material}-{config.seed}", robot.clock_s)
        rows: list[dict[str, Any]] = []
        executed: tuple[NDArray[np.float64], ...] = ()
        frames: list[NDArray[np.uint8]] = []
        goals: dict[str, Any] = {}
        for number, wanted in enumerate(setting.goals):
            name = f"{number}_{_name(wanted)}"
            folder = out / name
            folder.mkdir()
            height, _ = seen_m(robot.scan())
            fit = _goal(wanted, height, setting, robot)
            predicted = _predicted(
                height, fit, members, grid=grid, end_effector=end_effector, robot=robot, sculpting=sculpting,
                number=number, memory=PushMemory(executed, {}),
            )  # fmt: skip
            sculpture = sculpt(
                robot, end_effector, arguments.material, goal_m=fit.height_m, members=members, grid=grid,
                config=sculpting.planner, execution=sculpting.execution, count=sculpting.actions, session=session,
                item=number, log=run.log_under(name), earlier=executed, placer=placer,
                unexplained=model.facts.unexplained,
            )  # fmt: skip
            _pictures(folder, window_m, fit, predicted, sculpture)
            rows += sculpture.rows
            executed = (*executed, *sculpture.pushes)
            frames += [
                _shown(each, window_m, _FRAME_PX) for each in sculpture.heights_m[:: sculpting.execution.replan_every]
            ]
            metrics = _metrics(
                wanted, fit, predicted, sculpture=sculpture, config=config, reader=reader, setting=setting,
                window_m=window_m,
            )  # fmt: skip
            write_json(folder / "metrics.json", metrics)
            goals[name] = metrics
            run.log_picture(out / f"{name}.png")
        if rows:
            (out / "pushes").mkdir()
            write_shards(out / "pushes", _table(rows), CONTRACT)
        (out / "time_lapse.gif").write_bytes(time_lapse(frames, config.frame_ms))
        write_json(out / "metrics.json", goals)
        run.log_metrics(goals)


def _placer(setting: Setting, model: Path) -> Placer | None:
    if setting.sculpting.feeder is None:
        if any(wanted.raised_m > 0 for wanted in setting.goals):
            raise ConfigError(
                "A goal of params.yaml: sculpt.settings has raised_m above 0, and pushes only lower the material: name "
                "a feeder in its sculpting settings, or set raised_m to 0."
            )
        return None
    return Placer(load_feeder(setting.sculpting.feeder), read_place_model(model / PLACES))


def _robot(setting: Setting, end_effector: EndEffector, placer: Placer | None, config: Sculpt) -> SculptingRobot:
    robot = virtual_sculpting_robot(setting.world, config.scan_pixels, config.seed)
    places = None if placer is None else place_envelope_for(placer.feeder, robot.area_m)
    return GuardedSculptingRobot(robot, push_envelope_for(end_effector, robot.area_m), places)


def _goal(wanted: Wanted, height: Array, setting: Setting, robot: SculptingRobot) -> GoalFit:
    sculpting = setting.sculpting
    soften_px = sculpting.edge_blur_m * height.shape[1] / robot.area_m[0]
    depth = None
    if setting.depth_model is not None:
        from pentimento.semantics.depth import depth_relief  # imports transformers, which takes seconds

        depth = partial(depth_relief, folder=Path(setting.depth_model))
    shape = (height.shape[0], height.shape[1])
    relief = relief_of(wanted.source, shape, sculpting.side_share, soften_px=soften_px, depth=depth, up=wanted.up)
    if wanted.raised_m > 0:
        up = -relief if wanted.source.startswith("letter:") else relief  # letters are sunken
        return raised_goal(up, height, raised_m=wanted.raised_m, border_share=sculpting.fit.border_share)
    return fit_goal(relief, height, replace(sculpting.fit, depth_m=wanted.depth_m))


def _predicted(
    height: Array,
    fit: GoalFit,
    members: tuple[PushModel, ...],
    *,
    grid: tuple[int, int],
    end_effector: EndEffector,
    robot: SculptingRobot,
    sculpting: SculptingSettings,
    number: int,
    memory: PushMemory,
) -> PushPlan:
    """Plan all actions at once from the candidates alone, without execution in between."""
    objective = ClayObjective(fit.height_m, members[0].window_m, sculpting.planner.weights)
    foresight = EnsembleRollout(members, objective, sculpting.planner.disagreement_weight, memory=memory)
    reach = reach_for(end_effector, robot.area_m, sculpting.planner.edge_m)
    whole = replace(sculpting.planner, horizon=sculpting.actions, rounds=0, refine="none")
    return plan_for_scan(height, foresight, reach, grid=grid, config=whole, count=sculpting.actions, item=(number, 0))


def _metrics(
    wanted: Wanted,
    fit: GoalFit,
    predicted: PushPlan,
    *,
    sculpture: Sculpture,
    config: Sculpt,
    reader: LetterClassifier,
    setting: Setting,
    window_m: NDArray[np.float64],
) -> dict[str, Any]:
    objective = ClayObjective(fit.height_m, window_m, setting.sculpting.planner.weights)
    off_mm2 = (
        float(np.square(1e3 * (sculpture.heights_m[1:] - sculpture.predicted_m)).mean())
        if len(sculpture.actions)
        else 0.0
    )
    metrics: dict[str, Any] = {
        "source": wanted.source,
        "actions": len(sculpture.actions),
        "pellets": len(sculpture.actions) - len(sculpture.pushes),
        "stopped": sculpture.stopped,
        "helped": sculpture.helped,
        "holes_filled": sculpture.holes,
        "goal": {name: value for name, value in vars(fit).items() if name != "height_m"},
        "prediction_error_mm2": off_mm2,
        "curve": {
            "error_3d_mm2": objective.error_3d_mm2(sculpture.heights_m),
            "visual_error": objective.visual_error(sculpture.heights_m),
        },
        **goal_errors(objective, sculpture.heights_m, predicted.predicted_m[-1]),
    }
    letter = wanted.source.removeprefix("letter:")
    if wanted.source.startswith("letter:") and letter in config.classifier_letters and len(letter) == 1:
        metrics["read"] = classify_sculpture(
            reader, sculpture.heights_m[-1], fit.height_m, border=setting.sculpting.fit.border_share
        )
        metrics["read"]["right"] = metrics["read"]["clay"] == letter
    return metrics


def _pictures(
    folder: Path, window_m: NDArray[np.float64], fit: GoalFit, predicted: PushPlan, sculpture: Sculpture
) -> None:
    """Write photographs and height maps of the clay before, the goal, the plan and the clay after."""
    heights = (sculpture.heights_m[0], fit.height_m, predicted.predicted_m[-1], sculpture.heights_m[-1])
    shown = dict(zip(("before", "goal", "plan", "result"), heights, strict=True))
    for name, height in shown.items():
        write_png(folder / f"{name}.png", _shown(height, window_m, _PICTURE_PX))
        (folder / f"{name}_height.png").write_bytes(encode_height_png(height, HEIGHT_PER_UNIT_M))
    row = np.hstack([_shown(height, window_m, _PICTURE_PX) for height in shown.values()])
    write_png(folder.parent / f"{folder.name}.png", row)
    write_json(folder / "plan.json", {"actions": predicted.actions, "values": predicted.values})


def _shown(height_m: Array, window_m: NDArray[np.float64], side_px: int) -> NDArray[np.uint8]:
    return photograph(height_m, window_m, max(side_px // len(height_m), 1))


def _table(rows: list[dict[str, Any]]) -> pa.Table:
    names = {name for row in rows for name in row}
    schema = arrow_schema(CONTRACT, include_optional=names)
    for name in sorted(names - set(schema.names)):
        schema = schema.append(pa.field(name, pa.float32()))  # covariates of the room's sensors
    return pa.Table.from_pylist(rows, schema=schema)


def _name(wanted: Wanted) -> str:
    """Of a goal's folder."""
    kind, _, name = wanted.source.partition(":")
    return name if kind in ("letter", "shape") and name.isalnum() else Path(wanted.source).stem


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="sculpt", description=__doc__)
    parser.add_argument("--material", required=True)
    parser.add_argument("--model", required=True, type=Path, help="weights of a push model of that material")
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
