"""Paint and score twelve photographs: `python -m studies.colour_paintings paint NAME` and `… page`.

`paint NAME` plans and executes each photograph in the studio with the settings `paint` and `planners.colour` of
params.yaml, or with FRIDA's planner (`--frida`), into `OUT/NAME`; what is there is not done again. To score the planner
of another commit, put its `src` first in PYTHONPATH. `page` compares the names `frida`, `before` and `new`:
`docs/paintings.md` and its picture.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path

import torch

from pentimento.contracts.colour import linear_to_srgb, to_uint8
from pentimento.contracts.images import write_png
from pentimento.semantics.encoder import Encoder
from pipelines._config import load_section
from pipelines.paint import Paint
from studies.colour_paintings.frida import FridaConfig, frida_rates, frida_settings
from studies.colour_paintings.page import write_page
from studies.colour_paintings.painted import painted
from studies.colour_paintings.pictures import ALL, DEVELOPMENT, HELD_BACK
from studies.colour_paintings.scores import score

_FRIDA_ITERATIONS = 1000
_FRIDA_MULTIPLE = 1.0


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.colour_paintings", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("data/studies/colour_paintings"))
    commands = parser.add_subparsers(dest="command", required=True)
    paint = commands.add_parser("paint")
    paint.add_argument("name")
    paint.add_argument("--frida", action="store_true", help="FRIDA's planner")
    paint.add_argument("--weights", type=Path, default=Path("models/stroke_round_brush/weights"))
    paint.add_argument("--judge", type=Path, default=Path("base/weights/judge"), help="the encoder that never guides")
    paint.add_argument("--half", choices=("development", "held_back", "all"), default="all")
    commands.add_parser("page")
    args = parser.parse_args()
    torch.set_num_threads(1)
    if args.command == "page":
        write_page(args.out)
        return
    config = load_section(Path("params.yaml"), "paint", Paint)
    planner, frida = config.settings["colour"].planner, None
    if args.frida:
        frida = FridaConfig(_FRIDA_ITERATIONS, _FRIDA_MULTIPLE)
        planner = frida_settings(planner, frida_rates((0.3, 0.2), 4e-3, _FRIDA_MULTIPLE))
    judge = Encoder.load(args.judge)
    for name, picture in {"development": DEVELOPMENT, "held_back": HELD_BACK, "all": ALL}[args.half].items():
        folder = args.out / args.name / name
        if (folder / "scores.json").exists():
            continue
        result = painted(
            picture, planner, frida, weights=args.weights, strokes=config.strokes, replan_every=config.replan_every,
            seed=config.seed,
        )  # fmt: skip
        folder.mkdir(parents=True, exist_ok=True)
        write_png(folder / "target.png", to_uint8(linear_to_srgb(result.target)))
        write_png(folder / "predicted.png", result.predicted)
        write_png(folder / "painting.png", result.painting)
        scores = score(result.painting, result.target, result.paper, judge)
        seconds = {"planning_s": result.planning_s, "replanning_s": result.replanning_s}
        (folder / "scores.json").write_text(json.dumps(asdict(scores) | seconds, indent=2) + "\n")
        print(args.name, name, scores, seconds, flush=True)


if __name__ == "__main__":
    main()
