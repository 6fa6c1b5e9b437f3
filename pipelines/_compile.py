"""`make env`: compile what the first stages need; Numba keeps it beside the source.

    python -m pipelines._compile

A few strokes go through the studio, the training of a stroke model, the derivatives that the diagnosis uses, and the
planner. Without it, the first stages after an installation compile for a minute longer.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa

from pentimento.collection.collect import collect_strokes
from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.strokes import CONTRACT
from pentimento.control.guard import GuardedRobot
from pentimento.control.safety import envelope_for
from pentimento.diagnosis.strokes.aliasing import aliasing_of
from pentimento.diagnosis.strokes.fit import first_model
from pentimento.diagnosis.strokes.measured import load_measured
from pentimento.dynamics.strokes.extended import base_model
from pentimento.dynamics.strokes.mechanisms import VOCABULARY
from pentimento.dynamics.strokes.planned import TorchBrush
from pentimento.dynamics.strokes.samples import load_samples
from pentimento.dynamics.strokes.training import TrainingConfig, train
from pentimento.planning.strokes.config import no_log
from pentimento.planning.strokes.planner import plan
from pentimento.planning.strokes.scene import scene_with
from pentimento.robots.tools import load_tool
from pentimento.robots.virtual import virtual_robot
from pipelines._config import load_section
from pipelines._io import single_threaded
from pipelines.collect_strokes import CollectStrokes
from pipelines.paint import Paint

TOOL, CANVAS_M = "round_brush", (0.12, 0.08)
_STROKES = 8


def main() -> None:
    """Run each kind of computation once, at its smallest size."""
    single_threaded()
    params = Path("params.yaml")
    collection = load_section(params, "collect_strokes", CollectStrokes).collection
    training = load_section(params, "train_stroke_dynamics", TrainingConfig)
    planner = load_section(params, "paint", Paint).settings["colour"].planner
    tool = load_tool(TOOL)
    robot = GuardedRobot(virtual_robot(TOOL, CANVAS_M, seed=0), envelope_for(tool, CANVAS_M))
    rows = collect_strokes(robot, tool, replace(collection, strokes=_STROKES, repeated=1), no_log, None)
    table = pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT, include_optional=set(rows[0])))
    strokes = load_measured(table)
    aliasing_of(first_model(strokes), strokes, VOCABULARY)
    samples = load_samples(table, training.path_points, "auto", "auto")
    model = train(samples, replace(training, epochs=1), no_log).parameters_si()
    height, width = (round(side * planner.pixels_per_m) for side in reversed(CANVAS_M))
    blank = np.ones((height, width, 3), np.float32)
    grey = 0.5 * np.ones_like(blank)
    scene = scene_with(TorchBrush(base_model(model), tool, planner.path_points), tool, CANVAS_M, grey, None)
    quickest = replace(planner, iterations_per_round=1, iterations_free=1, iterations_palette=1)
    plan(blank, scene, _STROKES, quickest, no_log)


if __name__ == "__main__":
    main()
