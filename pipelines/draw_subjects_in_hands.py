"""Draw named things in every writer's style: does a judge see the thing, and a classifier the writer?"""

import argparse
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.demonstrations import CONTRACT
from pentimento.contracts.images import write_png
from pentimento.contracts.ranges import at_least
from pentimento.contracts.tables import read_table
from pentimento.dynamics.strokes.extended import read_stroke_model
from pentimento.handwriting.demonstrated import Demonstrated, demonstrated, split_last_session
from pentimento.handwriting.drawing import TorchPathBrush
from pentimento.handwriting.evaluation import StrokeClassifier
from pentimento.handwriting.subjects import SubjectSetting, contact_sheet, draw_grid, recognition
from pentimento.planning.strokes.latent import read_decoder
from pentimento.planning.strokes.shapes import BezierShapes, Shapes
from pentimento.robots.tools import load_tool
from pentimento.semantics.encoder import Encoder
from pentimento.semantics.objective import EncoderMeaning
from pipelines._config import load_section, require_model
from pipelines._io import output_folder, single_threaded, stage_main, write_json
from pipelines._tracking import tracked_run

BEZIER = "bezier"
"""The baseline without a writer."""


@dataclass(frozen=True)
class DrawSubjectsInHands:
    """Section `draw_subjects_in_hands` of params.yaml."""

    seed: int
    """Of the choice of things, of the studio and of the classifier."""
    views: int
    """Random views of a picture that the encoder sees at each iteration, beside the picture itself."""
    settings: dict[str, SubjectSetting]

    def __post_init__(self) -> None:
        at_least(self, 0, "seed", "views")


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: for each setting a contact sheet and its drawings; and metrics.json."""
    config = load_section(Path("params.yaml"), "draw_subjects_in_hands", DrawSubjectsInHands)
    for name, setting in config.settings.items():
        require_model(f"draw_subjects_in_hands.settings.{name}.tool", setting.tool, arguments.tools)
    single_threaded()
    tools = {
        setting.tool: arguments.models / f"stroke_{setting.tool}" / "weights" for setting in config.settings.values()
    }
    inputs = {
        "demonstrations": arguments.demonstrations, "hands": arguments.hands, "semantics": arguments.semantics,
        "judge": arguments.judge,
    } | {f"stroke_model.{tool}": weights for tool, weights in tools.items()}  # fmt: skip
    with (
        tracked_run("draw_subjects_in_hands", None, asdict(config), inputs) as run,
        output_folder(arguments.out) as out,
    ):
        guide, judge = Encoder.load(arguments.semantics), Encoder.load(arguments.judge)
        table = read_table(arguments.demonstrations, CONTRACT).table
        metrics = {}
        for name, setting in config.settings.items():
            planner, tool = setting.planner, load_tool(setting.tool)
            learned, held_out = split_last_session(demonstrated(table, planner.path_points))
            who = StrokeClassifier(_paths(learned), learned.hand, config.seed)
            kinds: dict[str, Shapes] = {
                hand: read_decoder(arguments.hands / "hands" / f"{hand}.npz") for hand in who.hands
            }
            grid = draw_grid(
                setting, kinds | {BEZIER: BezierShapes(tool, planner.path_points)},
                brush=TorchPathBrush(read_stroke_model(tools[tool.name]), tool, planner.path_points),
                meaning=EncoderMeaning(guide, config.views, planner.seed), judge=judge, seed=config.seed,
                log=_tell,
            )  # fmt: skip
            sheet = contact_sheet(grid, {hand: _paths(held_out.of(hand)) for hand in who.hands}, setting.side_m)
            (out / name).mkdir()
            write_png(out / name / "contact_sheet.png", sheet)
            run.log_picture(out / name / "contact_sheet.png", name)
            metrics[name] = recognition(grid, judge, who)
        write_json(out / "metrics.json", metrics)
        run.log_metrics(metrics)


def _tell(drawn: str) -> None:
    print(f"Drawn: {drawn}.", file=sys.stderr)


def _paths(strokes: Demonstrated) -> list[NDArray[np.float64]]:
    return list(strokes.strokes.xy_m.double().numpy())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="draw_subjects_in_hands", description=__doc__)
    parser.add_argument("--demonstrations", required=True, type=Path)
    parser.add_argument("--hands", required=True, type=Path, help="weights of TrajVAE")
    parser.add_argument("--models", required=True, type=Path, help="folder of stroke_<tool>")
    parser.add_argument("--tools", required=True, nargs="+", help="whose models are there")
    parser.add_argument("--semantics", required=True, type=Path, help="weights of the encoder that guides plans")
    parser.add_argument("--judge", required=True, type=Path, help="weights of an encoder that guides no plan")
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
