"""The stage sculpt: everything it promises, from a model that knows only the tool's shape, in the same bytes twice."""

import argparse
import json
from pathlib import Path

import pytest
import torch
from ruamel.yaml import YAML

import pipelines.sculpt as stage
from pentimento.contracts.errors import ConfigError
from pentimento.contracts.height_maps import decode_height_m
from pentimento.contracts.images import read_image
from pentimento.contracts.pushes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.dynamics.pushes.pose import Crop
from pentimento.dynamics.pushes.push_model import PushFacts, PushModel, write_push_model

GOALS = [{"source": "letter:A", "depth_m": 0.004}, {"source": "shape:dome", "depth_m": 0.004}]
SCULPTING = {
    "actions": 3, "side_share": 0.7, "edge_blur_m": 0.003,
    "fit": {
        "volume_weight": 1.0, "floor_weight": 10.0, "range_weight": 0.01, "rising_share": 0.3, "depth_m": 0.004,
        "border_share": 0.1,
    },
    "planner": {
        "weights": {"error_3d": 1.0, "visual": 2.0, "slope_scale_m": 0.0},
        "disagreement_weight": 0.0, "count_unexplained": False, "horizon": 2, "screened": 6,
        "candidates": 4, "rounds": 0, "guided_share": 0.8, "refine": "newton", "iterations": 1,
        "learning_rates": {"place_m": 0.002, "theta_rad": 0.15, "length_m": 0.003, "depth_m": 0.0006},
        "samples": 4, "elite_share": 0.5, "min_relative_gain": 0.001, "edge_m": 0.012, "seed": 0,
    },
    "execution": {"replan_every": 2, "patience": 8, "dwell_s": 0.5, "retract_speed_m_s": 0.05},
    "feeder": None,
}  # fmt: skip
SECTION = {
    "scan_pixels": 40, "classifier_letters": "AB", "classifier_examples": 8, "frame_ms": 50, "seed": 0,
    "settings": {
        "foam": {
            "world": "foam", "end_effector": "ball", "depth_model": None, "goals": GOALS, "sculpting": SCULPTING,
        },
    },
}  # fmt: skip


@pytest.fixture
def folder(stage_folder: Path) -> Path:
    YAML(typ="safe").dump({"sculpt": SECTION}, stage_folder / "params.yaml")
    write_model(stage_folder, "foam")
    return stage_folder


def write_model(folder: Path, material: str) -> None:
    torch.manual_seed(0)
    model = PushModel(PushFacts("push", ((material, "ball"),), Crop(20, 200.0, 0.03), 4, 0.04, 0.012, 1))
    with torch.no_grad():
        model.members[0].tool[:, 4] = 0.5  # half of what the tool's shape cuts stays pressed
    (folder / f"model_{material}").mkdir()
    write_push_model(model, folder / f"model_{material}")


def sculpted(folder: Path, name: str) -> dict[str, bytes]:
    stage.main(argparse.Namespace(material="foam", model=folder / "model_foam", out=folder / name))
    files = [file for file in (folder / name).rglob("*") if file.is_file()]
    return {str(file.relative_to(folder / name)): file.read_bytes() for file in files}


def test_goals_are_sculpted_one_after_another_in_the_same_clay(folder: Path) -> None:
    files = sculpted(folder, "out")
    assert sculpted(folder, "again") == files
    metrics = json.loads(files["metrics.json"])
    assert list(metrics) == ["0_A", "1_dome"]
    letter = metrics["0_A"]
    assert letter["actions"] == 3 and len(letter["curve"]["error_3d_mm2"]) == 4
    assert letter["error_3d_mm2"]["removed"] > 0 and letter["helped"]
    assert set(letter["read"]) == {"clay", "goal", "probability", "right"} and "read" not in metrics["1_dome"]
    rows = read_table(folder / "out" / "pushes", CONTRACT).table
    assert rows.num_rows == letter["actions"] + metrics["1_dome"]["actions"]
    before, after = (decode_height_m(files[f"{name}_height.png"], 1e-6) for name in ("0_A/result", "1_dome/before"))
    assert abs(before - after).max() < 1e-3  # the dome began where the A ended; both are scans with their noise
    assert read_image(folder / "out/0_A/plan.png").shape == (360, 360, 3)
    assert len(json.loads(files["0_A/plan.json"])["actions"]) <= 3


def test_a_model_of_another_material_is_refused(folder: Path) -> None:
    write_model(folder, "sand")
    with pytest.raises(ConfigError, match="was trained on sand with ball"):
        stage.main(argparse.Namespace(material="foam", model=folder / "model_sand", out=folder / "out"))
    assert not (folder / "out").exists()
