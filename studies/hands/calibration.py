"""Strokes of a writer or Bézier strokes to calibrate a stroke model with (thesis 5.3.4).

    PYTHONPATH=src python -m studies.hands.calibration OUT.json

In the repository's root, after `make repro`. For three seeds, the robot in the studio collects equally many strokes of
each kind with the marker. Traj2Stroke is fitted to each with the settings of params.yaml and tested on
further collections of every kind. Results are written after each model, and a run that was interrupted goes on.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa

from pentimento.collection.collect import collect_strokes
from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.strokes import CONTRACT
from pentimento.control.guard import GuardedRobot
from pentimento.control.safety import envelope_for
from pentimento.dynamics.strokes.evaluation import blank, score, score_model
from pentimento.dynamics.strokes.samples import StrokeSamples, load_samples
from pentimento.dynamics.strokes.training import TrainingConfig, train
from pentimento.planning.strokes.latent import read_decoder
from pentimento.planning.strokes.shapes import Shapes
from pentimento.robots.tools import load_tool
from pentimento.robots.virtual import VirtualRobot
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import load_world
from pipelines._config import load_section
from pipelines._io import single_threaded
from pipelines.collect_strokes import CollectStrokes

TOOL: Final = "marker"
BEZIER: Final = "bezier"
SEEDS: Final = (1, 2, 3)
TEST_STROKES: Final = 60
_TEST_SEED: Final = 100
"""Added to a seed for the design of the test collection, which the same studio draws."""


def main() -> None:
    """Collect, fit, test and write; then print the table."""
    parser = argparse.ArgumentParser(prog="studies.hands.calibration", description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--hands", type=Path, default=Path("models/trajvae/weights/hands"))
    parser.add_argument("--writers", nargs="+", default=["loops", "zigzags"])
    arguments = parser.parse_args()
    single_threaded()
    collection = load_section(Path("params.yaml"), "collect_strokes", CollectStrokes).collection
    training = load_section(Path("params.yaml"), "train_stroke_dynamics", TrainingConfig)
    kinds: dict[str, Shapes | None] = {BEZIER: None}
    kinds |= {writer: read_decoder(arguments.hands / f"{writer}.npz") for writer in arguments.writers}
    found: dict[str, Any] = json.loads(arguments.out.read_text()) if arguments.out.exists() else {}

    def collected(kind: str, count: int, seed: int, studio_seed: int) -> StrokeSamples:
        tool, shapes = load_tool(TOOL), kinds[kind]
        config = replace(collection, strokes=count, repeated=0, seed=seed)
        robot = VirtualRobot(Studio(load_world(TOOL), studio_seed))
        guarded = GuardedRobot(robot, envelope_for(tool, robot.canvas_size_m))
        rows = collect_strokes(guarded, tool, config, lambda *_: None, shapes)
        table = pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT, include_optional=set(rows[0])))
        return load_samples(table, training.path_points, training.pixels_per_m, training.margin_m)

    for seed in SEEDS:
        missing = [kind for kind in kinds if f"{kind}_{seed}" not in found]
        tests = {kind: collected(kind, TEST_STROKES, _TEST_SEED + seed, seed) for kind in kinds} if missing else {}
        for kind in missing:
            samples = collected(kind, collection.strokes, seed, seed)
            model = train(samples, replace(training, seed=seed), lambda *_: None).parameters_si()
            found[f"{kind}_{seed}"] = {
                on: asdict(score_model(model, test)) | {"blank_mse": score(blank(test), test).mse}
                for on, test in tests.items()
            }
            arguments.out.write_text(json.dumps(found, indent=1))
            print(f"{kind}, seed {seed}: {found[f'{kind}_{seed}']}", file=sys.stderr)
    for score_name in ("mse", "iou"):
        print(f"| {score_name}; trained on | {' | '.join(f'tested on {on}' for on in kinds)} |")
        for kind in kinds:
            of_seeds = {on: np.array([found[f"{kind}_{seed}"][on][score_name] for seed in SEEDS]) for on in kinds}
            cells = (f"{values.mean():.5f} ± {values.std(ddof=1):.5f}" for values in of_seeds.values())
            print(f"| {kind} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
