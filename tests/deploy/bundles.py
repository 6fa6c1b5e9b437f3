"""A small bundle of untrained models with many exported parts, written once for all tests."""

from __future__ import annotations

import json
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import torch

from pentimento.bundle.reader import MANIFEST
from pentimento.contracts.codec import to_plain
from pentimento.contracts.covariates import PICKUP_COLUMNS
from pentimento.copainting.goal.planner import GoalSampling, save_goal_planner
from pentimento.deploy.bundle import (
    ClayConfig,
    DeployConfig,
    Models,
    SettingConfig,
    graph_entry,
    graph_files,
    write_bundle,
)
from pentimento.deploy.graphs import Graph
from pentimento.dynamics.pushes.param2deform import Param2Deform
from pentimento.dynamics.pushes.pose import Crop
from pentimento.dynamics.pushes.push_model import PushFacts, PushModel
from pentimento.dynamics.strokes.extended import StrokeModel
from pentimento.dynamics.strokes.mechanisms import VOCABULARY
from pentimento.dynamics.strokes.simulation import Mechanism
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from pentimento.planning.pushes.analytic.correction import Correction, Range
from pentimento.planning.pushes.analytic.mechanisms.stiffness_drift import StiffnessDrift
from pentimento.planning.pushes.analytic.mechanisms.tool_backlash import ToolBacklash
from pentimento.planning.pushes.analytic.mechanisms.work_hardening import WorkHardening
from pentimento.planning.pushes.analytic.model import BASE, START, AnalyticPush
from pentimento.planning.strokes.brush import Span, StrokeTiming
from pentimento.semantics.encoder import Encoder, new_model
from tests.bundle.small_hands import HAND_POINTS, small_hand
from tests.bundle.tiny_bundle import CANVAS_M, HAND_PLANNER, PLANNER, change, relist
from tests.control.sculpting_bundle import SETTINGS
from tests.copainting.goal_planners import ENCODER, small_encoder, small_planner
from tests.dynamics.strokes.test_correction import some_correction

CONFIG = DeployConfig(
    tolerance=1e-4,
    half_tolerance=None,
    views=1,
    sampling=GoalSampling(2, 1.0, 5.0),
    vocabulary="named",
    settings={"small": SettingConfig("marker", "with a marker", CANVAS_M, 6, 3, False, PLANNER)},
    clays={"foam": ClayConfig((0.0, 0.0, 0.1, 0.08), (40, 50), SETTINGS)},
    hand_planner=HAND_PLANNER,
)
BRUSH = f"marker_{PLANNER.path_points}"
PATH_BRUSH = f"marker_{HAND_POINTS}_path"
DIGESTS = {"stroke_marker": "1", "semantics": "2", "goal": "3", "push_foam": "4", "hands": "5"}


def mechanism(cause: str, values: list[float], reference: dict[str, float]) -> Mechanism:
    """One of the vocabulary."""
    kind = {kind.cause: kind for kind in VOCABULARY}[cause]
    return kind(torch.tensor(values), reference)


def stroke_model() -> StrokeModel:
    """Its mark is corrected, its ink runs down, it stirs wet paint, and its camera sees a gradient of light."""
    mechanisms = (
        mechanism("ink_depletion", [0.2, 0.1], {"column": 0.0, "since": 0.05}),
        mechanism("wet_mixing", [0.3, 0.1, 0.5], {"usual_age_s": 60.0}),
        mechanism("illumination_gradient", [0.02, 0.01, 0.03, -0.02], {"x_m": 0.03, "y_m": 0.02, "half_m": 0.03}),
    )
    parameters = Traj2StrokeParameters((1.01, 0.99), (1e-4, -1e-4), 0.3, 1e-3, 0.2, 0.9)
    fitted = {"ink_since_reload_m": Span(0.0, 0.05, 0.1), "wet_age_s": Span(1.0, 60.0, 300.0)}
    fitted |= {name: Span(0.0, 0.3, 1.0) for name in PICKUP_COLUMNS}
    correction = some_correction(turned=False).float()
    return StrokeModel(parameters, mechanisms, fitted, StrokeTiming(2.0, 5.0), correction)


@cache
def small_bundle() -> tuple[Path, Models]:
    """The bundle's folder and its models. No test may change the folder."""
    folder = Path(tempfile.mkdtemp(prefix="bundle-"))
    models = small_models(folder)
    (folder / "bundle").mkdir()
    write_bundle(folder / "bundle", models, CONFIG)
    return folder / "bundle", models


def put_graphs(bundle: Path, graphs: dict[str, Graph]) -> None:
    """Replace graphs of a bundle, with their tensors, and list them and their models."""
    for name, data in graph_files(graphs).items():
        (bundle / name).write_bytes(data)
    manifest = json.loads((bundle / MANIFEST).read_text())
    entries = {name: to_plain(graph_entry(name, graph)) for name, graph in graphs.items()}
    models = {model: "2" for graph in graphs.values() for model in graph.models}
    change(bundle, graphs=manifest["graphs"] | entries, models=manifest["models"] | models)
    relist(bundle)


def small_models(folder: Path) -> Models:
    """An untrained encoder and goal planner, saved in the folder, too."""
    tokenizer = small_encoder().tokenizer
    # Of convolutions alone, as the pipeline's own.
    encoder, goal = Encoder(new_model(replace(ENCODER, image_layers=0), tokenizer, 0), tokenizer), small_planner()
    (folder / "encoder").mkdir()
    encoder.save(folder / "encoder")
    save_goal_planner(goal, folder / "goal")
    return Models(
        {"marker": stroke_model()}, encoder, folder / "encoder", goal, folder / "goal", {"foam": push_model()}, DIGESTS,
        {"arcs": small_hand("arcs"), "anna": small_hand("anna")}, {"foam": push_correction()},
    )  # fmt: skip


def push_correction() -> Correction:
    """The material hardens where it was pushed and stiffens with time, and the arm has play along x."""
    base = AnalyticPush(0.012, np.array([START[name] for name in BASE]), ())
    time = {"time_column": 0.0, "time_middle": 300.0, "time_half": 300.0}
    causes = (
        WorkHardening(np.array([0.3, 0.8]), {}),
        StiffnessDrift(np.array([-0.2, 0.0]), time),
        ToolBacklash(np.array([1e-3, 0.0]), {}),
    )
    return Correction(base.plus(*causes), base, 0.008, {"t_start_s": Range(0.0, 300.0, 600.0)})


def push_model() -> PushModel:
    """An untrained ensemble, in which the tool presses."""
    torch.manual_seed(0)
    model = PushModel(PushFacts("push", (("foam", "ball"),), Crop(24, 500.0, 0.014), 4, 0.02, 0.008, 2))
    for number, member in enumerate(model.members):
        assert isinstance(member, Param2Deform)
        member.tool.data[:, 4] = 0.7 + 0.1 * number
    return model.eval().requires_grad_(False)
