"""Draw a photograph in every writer's style and with Bézier strokes, and classify who drew it."""

import argparse
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.calibration.observe import calibrate_camera
from pentimento.contracts.colour import linear_to_srgb, to_float, to_uint8
from pentimento.contracts.demonstrations import CONTRACT
from pentimento.contracts.images import write_png
from pentimento.contracts.markers import markers_around
from pentimento.contracts.plan import Plan, PlanHeader, write_plan
from pentimento.contracts.ranges import above_zero, at_least
from pentimento.contracts.tables import read_table
from pentimento.control.guard import GuardedRobot
from pentimento.control.painter import as_linear, observe
from pentimento.control.safety import envelope_for
from pentimento.dynamics.strokes.extended import read_stroke_model
from pentimento.handwriting.demonstrated import Demonstrated, demonstrated, split_last_session
from pentimento.handwriting.drawing import Drawing, TorchPathBrush, draw_shapes
from pentimento.handwriting.evaluation import StrokeClassifier
from pentimento.planning.objectives import PrintObjective
from pentimento.planning.strokes.config import ShapedPlanConfig
from pentimento.planning.strokes.latent import read_decoder
from pentimento.planning.strokes.scene import Scene, scene_with
from pentimento.planning.strokes.shapes import BezierShapes, Shapes
from pentimento.planning.strokes.target import Part, fit_to_canvas, fit_to_ink, load_photograph
from pentimento.robots.tools import load_tool
from pentimento.robots.virtual import VirtualRobot
from pentimento.semantics.encoder import Encoder
from pentimento.semantics.objective import EncoderMeaning
from pentimento.semantics.scores import embed_all
from pentimento.semantics.style import style_of
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import load_world
from pipelines._config import entry_of, load_section, require_model
from pipelines._io import output_folder, single_threaded, stage_main, write_json
from pipelines._tracking import Run, tracked_run

Image = NDArray[np.uint8]

BEZIER, NOBODY = "bezier", "nobody"
"""Baselines: Bézier strokes, and latents of the generic decoder."""
_IN_A_ROW = 4


@dataclass(frozen=True)
class HandSetting:
    """One photograph, drawn in every hand."""

    photograph: str
    """A file, or the name of a photograph that scikit-image ships."""
    part: Part
    """Of the photograph."""
    tool: str
    world: str
    """The studio's."""
    darkest: float
    """For a tool with its own ink: the lightness (0 to 1) of the target's darkest tone."""
    ink_length_m: float
    """Approximate length of line in each drawing, which makes drawings comparable."""
    replan_every: int
    """Strokes between two photographs, each of which replans the rest."""
    planner: ShapedPlanConfig

    def __post_init__(self) -> None:
        at_least(self, 0, "darkest")
        at_least(self, 1, "replan_every")
        above_zero(self, "ink_length_m")
        if self.darkest >= 1:
            raise ValueError(f"darkest is {self.darkest}; it must be below 1, or the target is all white.")


@dataclass(frozen=True)
class DrawInHands:
    """Section `draw_in_hands` of params.yaml."""

    seed: int
    """Of the studio and of the classifier."""
    views: int
    """Random views of a picture that the encoder sees at each iteration, beside the picture itself."""
    settings: dict[str, HandSetting]

    def __post_init__(self) -> None:
        at_least(self, 0, "seed", "views")


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: a folder for each drawing, all of them side by side, and metrics.json with a confusion matrix."""
    section = load_section(Path("params.yaml"), "draw_in_hands", DrawInHands)
    config = entry_of(section.settings, arguments.setting, "draw_in_hands.settings")
    require_model(f"draw_in_hands.settings.{arguments.setting}.tool", config.tool, arguments.tools)
    single_threaded()
    weights = arguments.models / f"stroke_{config.tool}" / "weights"
    inputs = {
        "demonstrations": arguments.demonstrations, "hands": arguments.hands, "stroke_model": weights,
        "semantics": arguments.semantics, "judge": arguments.judge,
    }  # fmt: skip
    params = {"seed": section.seed, "views": section.views} | asdict(config)
    with (
        tracked_run("draw_in_hands", arguments.setting, params, inputs) as run,
        output_folder(arguments.out) as out,
    ):
        tool = load_tool(config.tool)
        table = read_table(arguments.demonstrations, CONTRACT).table
        learned, held_out = split_last_session(demonstrated(table, config.planner.path_points))
        who = StrokeClassifier(_paths(learned), learned.hand, section.seed)
        files = arguments.hands / "hands"
        ways: dict[str, Shapes] = {hand: read_decoder(files / f"{hand}.npz") for hand in learned.hands}
        ways |= {
            NOBODY: read_decoder(arguments.hands / "nobody.npz"),
            BEZIER: BezierShapes(tool, config.planner.path_points),
        }
        brush = TorchPathBrush(read_stroke_model(weights), tool, config.planner.path_points)
        meaning = EncoderMeaning(Encoder.load(arguments.semantics), section.views, config.planner.seed)
        blank = _photographed(_robot(config, section.seed), config)
        scene = _scene(brush, config, blank.shape[:2], meaning)
        drawings = {name: _drawn(name, shapes, scene, config, run, section.seed) for name, shapes in ways.items()}
        target = to_uint8(linear_to_srgb(scene.target))
        write_png(out / "target.png", target)
        for name, drawing in drawings.items():
            _write(out / name, drawing, scene)
        write_png(out / "drawings.png", _in_rows([target, *(drawing.photo for drawing in drawings.values())]))
        metrics = {
            "error": _errors(drawings, scene, blank, config),
            "semantic_similarity": _meanings(drawings, target, blank, arguments.judge),
            "strokes": {name: len(drawing.executed) for name, drawing in drawings.items()},
            "ink_length_m": {name: _length_m(drawing) for name, drawing in drawings.items()},
            "taken_for": _taken_for(who, drawings, held_out),
        }
        write_json(out / "metrics.json", metrics)
        run.log_metrics(metrics)
        run.log_picture(out / "drawings.png")


def _robot(config: HandSetting, seed: int) -> GuardedRobot:
    """Return a new robot with the same blank sheet."""
    robot = VirtualRobot(Studio(load_world(config.world), seed))
    return GuardedRobot(robot, envelope_for(load_tool(config.tool), robot.canvas_size_m))


def _photographed(robot: GuardedRobot, config: HandSetting) -> Image:
    calibration = calibrate_camera(robot.photo(), markers_around(robot.canvas_size_m))
    return observe(robot, calibration, config.planner.pixels_per_m)


def _scene(brush: TorchPathBrush, config: HandSetting, shape: tuple[int, int], meaning: EncoderMeaning) -> Scene:
    """Return the scene to draw, [H, W] pixels."""
    target = fit_to_canvas(config.part.of(load_photograph(config.photograph)), shape)
    if brush.tool.color_srgb is not None:
        target = fit_to_ink(target, config.darkest)
    canvas_size_m = (shape[1] / config.planner.pixels_per_m, shape[0] / config.planner.pixels_per_m)
    return scene_with(brush, brush.tool, canvas_size_m, target.astype(np.float32), style_of(config.planner), meaning)


def _drawn(name: str, shapes: Shapes, scene: Scene, config: HandSetting, run: Run, seed: int) -> Drawing:
    robot = _robot(config, seed)
    calibration = calibrate_camera(robot.photo(), markers_around(robot.canvas_size_m))
    return draw_shapes(
        robot, calibration, scene, shapes=shapes, ink_m=config.ink_length_m, replan_every=config.replan_every,
        config=config.planner, log=run.log_under(name),
    )  # fmt: skip


def _write(folder: Path, drawing: Drawing, scene: Scene) -> None:
    folder.mkdir()
    envelope = envelope_for(scene.tool, scene.canvas_size_m).id
    header = PlanHeader(scene.tool.name, drawing.palette_srgb, scene.canvas_size_m, envelope)
    write_plan(folder / "plan.jsonl", Plan(header, tuple(drawing.executed)))
    write_png(folder / "drawing.png", drawing.photo)
    write_png(folder / "plan.png", drawing.predicted)


def _in_rows(pictures: Sequence[Image]) -> Image:
    """Pictures of one size side by side, in rows of four."""
    rows = [[*pictures[start : start + _IN_A_ROW]] for start in range(0, len(pictures), _IN_A_ROW)]
    rows[-1] += [np.full_like(pictures[0], 255)] * (_IN_A_ROW - len(rows[-1]))
    return np.vstack([np.hstack(row) for row in rows])


def _errors(drawings: dict[str, Drawing], scene: Scene, blank: Image, config: HandSetting) -> dict[str, float]:
    """Return the print objective of each photograph against the target."""
    objective = PrintObjective(scene.target, config.planner.distances_px)
    photos = {name: drawing.photo for name, drawing in drawings.items()} | {"blank": blank}
    return {name: objective(as_linear(photo))[0] for name, photo in photos.items()}


def _meanings(drawings: dict[str, Drawing], target: Image, blank: Image, judge: Path) -> dict[str, float]:
    """Return the cosine of each photograph with the target, by an encoder that guided none of them."""
    photos = {name: drawing.photo for name, drawing in drawings.items()} | {"blank": blank}
    images = torch.stack([_tensor(image) for image in (target, *photos.values())])
    seen = embed_all(Encoder.load(judge), images)
    return dict(zip(photos, (seen[1:] @ seen[0]).tolist(), strict=True))


def _tensor(image: Image) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(to_float(image).transpose(2, 0, 1)).astype(np.float32))


def _taken_for(who: StrokeClassifier, drawings: dict[str, Drawing], held_out: Demonstrated) -> dict[str, Any]:
    """Return the fraction of executed strokes classified as each writer's, by measured path; rows: who drew.

    The same is returned for people's strokes of a held-out session.
    """
    executed = {name: who.shares(drawing.measured_m) for name, drawing in drawings.items()}
    people = {hand: who.shares(_paths(held_out.of(hand))) for hand in who.hands}
    diagonal = [float(executed[hand][k]) for k, hand in enumerate(who.hands)]
    return {
        "hands": list(who.hands),
        "executed": executed,
        "people": people,
        "diagonal": float(np.mean(diagonal)),
        "diagonal_min": min(diagonal),
        "diagonal_people": float(np.mean([people[hand][k] for k, hand in enumerate(who.hands)])),
        "chance": 1 / len(who.hands),
    }


def _paths(strokes: Demonstrated) -> list[NDArray[np.float64]]:
    return list(strokes.strokes.xy_m.double().numpy())


def _length_m(drawing: Drawing) -> float:
    paths = (stroke.path[:, 1:3] for stroke in drawing.executed)
    return float(sum(np.linalg.norm(np.diff(path, axis=0), axis=1).sum() for path in paths))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="draw_in_hands", description=__doc__)
    parser.add_argument("--setting", required=True)
    parser.add_argument("--demonstrations", required=True, type=Path)
    parser.add_argument("--hands", required=True, type=Path, help="weights of TrajVAE")
    parser.add_argument("--models", required=True, type=Path, help="folder of stroke_<tool>")
    parser.add_argument("--tools", required=True, nargs="+", help="whose models are there")
    parser.add_argument("--semantics", required=True, type=Path, help="weights of the encoder that guides plans")
    parser.add_argument("--judge", required=True, type=Path, help="weights of an encoder that guides no plan")
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
