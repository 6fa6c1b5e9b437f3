"""Let a simulated person and the robot draw in turns on one sheet in the studio."""

import argparse
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import to_float
from pentimento.contracts.images import write_png
from pentimento.contracts.ranges import at_least
from pentimento.copainting.drawings.scenes import WHITE, DrawnScene, Placed, render_scene
from pentimento.copainting.evaluation.codraw import Codrawing, Story, Turn, film_strip
from pentimento.copainting.evaluation.goal_plans import as_picture, as_sheet, load_paint_context
from pentimento.copainting.goal.planner import SeededSampling
from pentimento.copainting.sheets import side_by_side
from pentimento.deploy.words import taught_vocabulary
from pipelines._config import load_section, require_model
from pipelines._io import output_folder, single_threaded, stage_main, write_json
from pipelines._play import EvaluatedSetting, play
from pipelines._tracking import tracked_run

_LINE = 0.02  # width of the person's lines, in sides of the sheet
_SHOWN_PX = 256


@dataclass(frozen=True)
class DrawnThing:
    """What the person draws, as OpenMoji does."""

    noun: str
    x: float
    """Of its centre, in sides of the sheet, to the right."""
    y: float
    """Down."""
    size: float
    """Of its square, in sides of the sheet."""


@dataclass(frozen=True)
class DuetTurn:
    """One turn."""

    draws: DrawnThing | None
    """By the person; null for nothing."""
    asks: str
    """What the robot shall add."""


@dataclass(frozen=True)
class Duet:
    """Section `duet` of params.yaml."""

    picture_px: int
    """Side of the goal planner's pictures."""
    setting: EvaluatedSetting
    sampling: SeededSampling
    """Of the goal planner."""
    codrawing: Codrawing
    turns: tuple[DuetTurn, ...]
    seed: int
    """Of the studio and of the person's tremor."""

    def __post_init__(self) -> None:
        at_least(self, 8, "picture_px")
        at_least(self, 0, "seed")
        if not self.turns:
            raise ValueError("turns is empty; give one or more.")


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: turns.png, sheet.png and metrics.json."""
    config = load_section(Path("params.yaml"), "duet", Duet)
    medium = config.setting.medium
    require_model("duet.setting.medium.tool", medium.tool, arguments.tools)
    single_threaded()
    model = arguments.models / f"stroke_{medium.tool}" / "weights"
    inputs = {"goal": arguments.goal, "stroke_model": model}
    with tracked_run("duet", None, asdict(config), inputs) as run, output_folder(arguments.out) as out:
        context = load_paint_context(medium, model)
        turns = play(
            arguments.goal, _story(config, has_ink=context.tool.color_srgb is not None), context,
            world=config.setting.world, sampling=config.sampling, codrawing=config.codrawing,
            vocabulary=taught_vocabulary("named"), seed=config.seed,
        )  # fmt: skip
        shown = (_SHOWN_PX, _SHOWN_PX)
        write_png(out / "turns.png", side_by_side(film_strip(turns), [turn.prompt for turn in turns], shown))
        write_png(out / "sheet.png", turns[-1].after)
        measured = [_measured(turn) for turn in turns]
        write_json(out / "metrics.json", {"tool": medium.tool, "turns": measured})
        run.log_metrics({f"turn_{number}": figures["error"] for number, figures in enumerate(measured, 1)})
        run.log_picture(out / "turns.png")


def _story(config: Duet, *, has_ink: bool) -> Story:
    """The turns with the pictures of what the person draws, [picture_px, picture_px]."""
    return Story(
        scene_id="duet",
        prompts=tuple(turn.asks for turn in config.turns),
        images=tuple(None if turn.draws is None else _picture(turn.draws, config, has_ink) for turn in config.turns),
        side_px=config.picture_px,
        first=None,
    )


def _picture(thing: DrawnThing, config: Duet, has_ink: bool) -> NDArray[np.uint8]:
    placed = Placed(thing.noun, "openmoji", thing.x, thing.y, thing.size, 0.0, False)
    scene = DrawnScene("alone", (placed,), (0,), None, WHITE, _LINE)
    return render_scene(scene, [0], "marker" if has_ink else "colour", side_px=config.picture_px).image


def _measured(turn: Turn) -> dict[str, Any]:
    """The turn's request, its strokes, and the error against the goal before and after the robot's: MSE in sRGB."""
    side = turn.goal.shape[0]
    goal = to_float(turn.goal)
    seen = {
        name: to_float(as_picture(as_sheet(photo, photo.shape[0]), side))
        for name, photo in (("no_change", turn.started), ("drawn", turn.after))
    }
    return {
        "asked": turn.prompt,
        "strokes": {"person": turn.strokes[0], "robot": turn.strokes[1]},
        "error": {name: float(np.square(picture - goal).mean()) for name, picture in seen.items()},
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="duet", description=__doc__)
    parser.add_argument("--goal", required=True, type=Path, help="the goal planner")
    parser.add_argument("--models", required=True, type=Path, help="folder of stroke_<tool>")
    parser.add_argument("--tools", required=True, nargs="+", help="whose models are there")
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
