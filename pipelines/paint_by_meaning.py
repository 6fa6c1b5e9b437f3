"""Paint by what pictures and words mean: each sum of objectives beside its terms, scored by another encoder."""

import argparse
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pentimento.contracts.colour import linear_to_srgb, to_uint8
from pentimento.contracts.images import write_png
from pentimento.contracts.ranges import at_least
from pentimento.contracts.scenes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.copainting.evaluation.by_meaning import (
    MeaningSetting,
    Networks,
    PaintedByMeaning,
    Picture,
    nearest_picture,
    paint_by_meaning,
    rank_of_words,
    similarity,
)
from pentimento.dynamics.strokes.extended import read_stroke_model
from pentimento.planning.strokes.target import load_photograph
from pentimento.semantics.encoder import Encoder
from pipelines._config import load_section, require_model
from pipelines._io import output_folder, single_threaded, stage_main, write_json
from pipelines._tracking import tracked_run


@dataclass(frozen=True)
class PaintByMeaning:
    """Section `paint_by_meaning` of params.yaml."""

    views: int
    """Random views of a picture that the encoder sees at each iteration, beside the picture itself."""
    seed: int
    """Of the studio."""
    settings: dict[str, MeaningSetting]

    def __post_init__(self) -> None:
        at_least(self, 0, "views", "seed")


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: for each setting a folder of its target and paintings; and metrics.json."""
    config = load_section(Path("params.yaml"), "paint_by_meaning", PaintByMeaning)
    for name, setting in config.settings.items():
        require_model(f"paint_by_meaning.settings.{name}.tool", setting.tool, arguments.tools)
    single_threaded()
    inputs = {"scenes": arguments.scenes, "semantics": arguments.semantics, "judge": arguments.judge}
    tools = {
        setting.tool: arguments.models / f"stroke_{setting.tool}" / "weights" for setting in config.settings.values()
    }
    inputs |= {f"stroke_model.{tool}": weights for tool, weights in tools.items()}
    with tracked_run("paint_by_meaning", None, asdict(config), inputs) as run, output_folder(arguments.out) as out:
        networks = Networks(Encoder.load(arguments.semantics), Encoder.load(arguments.judge), config.views)
        metrics = {}
        for name, setting in config.settings.items():
            model = read_stroke_model(tools[setting.tool])
            start = _start(setting, arguments.scenes, networks.guide)
            target, painted = paint_by_meaning(setting, start, model, networks, studio_seed=config.seed)
            picture = to_uint8(linear_to_srgb(np.clip(target, 0.0, 1.0)))
            (out / name).mkdir()
            write_png(out / name / "target.png", picture)
            write_json(out / name / "setting.json", _facts(setting))
            for kind, painting in painted.items():
                write_png(out / name / f"{kind}_planned.png", painting.planned)
                write_png(out / name / f"{kind}_painted.png", painting.painted)
                run.log_picture(out / name / f"{kind}_painted.png", name)
            metrics[name] = {
                kind: _metrics(painting, picture, setting, networks.judge) for kind, painting in painted.items()
            }
        write_json(out / "metrics.json", metrics)
        run.log_metrics(metrics)


def _start(setting: MeaningSetting, scenes: Path, guide: Encoder) -> Picture:
    """Return the setting's picture, or the one from which its words start."""
    if setting.picture is not None:
        return load_photograph(setting.picture)
    text = setting.planner.objectives.text
    assert text is not None  # __post_init__ saw to it
    return nearest_picture(text.words, read_table(scenes, CONTRACT).table.to_pylist(), guide)


def _facts(setting: MeaningSetting) -> dict[str, Any]:
    """Return what the report says of a setting."""
    objectives = setting.planner.objectives
    words = None if objectives.text is None else objectives.text.words
    style = None if objectives.style is None else objectives.style.picture
    weights = {"print": objectives.print_weight, "semantic": objectives.semantic_weight}
    weights |= {} if objectives.text is None else {"text": objectives.text.weight}
    weights |= {} if objectives.style is None else {"style": objectives.style.weight}
    return {
        "tool": setting.tool, "strokes": setting.strokes, "picture": setting.picture, "words": words, "style": style,
        "weights": {name: weight for name, weight in weights.items() if weight > 0},
    }  # fmt: skip


def _metrics(painting: PaintedByMeaning, target: Picture, setting: MeaningSetting, judge: Encoder) -> dict[str, Any]:
    """Return the objectives of the plan, and the judge's scores of plan and painting."""
    pictures, text = {"planned": painting.planned, "painted": painting.painted}, setting.planner.objectives.text
    found: dict[str, Any] = {"objectives": painting.objectives}
    for name, picture in pictures.items():
        found[name] = {"similarity": similarity(judge, picture, target)}
        if text is not None:
            found[name]["rank_of_words"] = rank_of_words(judge, picture, text.words)
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="paint_by_meaning", description=__doc__)
    parser.add_argument("--scenes", required=True, type=Path)
    parser.add_argument("--models", required=True, type=Path, help="folder of stroke_<tool>")
    parser.add_argument("--tools", required=True, nargs="+", help="whose models are there")
    parser.add_argument("--semantics", required=True, type=Path)
    parser.add_argument("--judge", required=True, type=Path)
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
