"""The stage train_push_dynamics: a model that is read again, scores beside what is trivial, the same bytes twice."""

import argparse
import json
from pathlib import Path

import pytest
from ruamel.yaml import YAML

import pipelines.train_push_dynamics as stage
from pentimento.contracts.images import read_image
from pentimento.contracts.pushes import CONTRACT, example_table
from pentimento.contracts.tables import write_table
from pentimento.dynamics.pushes.push_model import read_push_model

SECTION = {
    "pixels_per_m": 640.0,
    "side_px": 40, "behind_m": 0.03, "channels": 4, "members": 1, "epochs": 3, "batch": 8, "learning_rate": 0.004,
    "visual_weight": 1.0, "held_out": 0.25, "seed": 0,
}  # fmt: skip


@pytest.fixture
def folder(stage_folder: Path) -> Path:
    YAML(typ="safe").dump({"train_push_dynamics": SECTION}, stage_folder / "params.yaml")
    write_table(stage_folder / "pushes", example_table(24), CONTRACT, "Examples.")
    return stage_folder


def test_a_model_comes_out_with_its_scores_and_again_in_the_same_bytes(folder: Path) -> None:
    for name in ("one", "other"):
        stage.main(argparse.Namespace(material="foam", pushes=folder / "pushes", out=folder / name))
    one, other = ({file.name: file.read_bytes() for file in (folder / n).iterdir()} for n in ("one", "other"))
    assert one == other
    metrics = json.loads(one["metrics.json"])
    assert metrics["held_out"]["model"]["l_3d_mm2"] < metrics["held_out"]["unchanged"]["l_3d_mm2"]
    assert metrics["pushes"] | {"training": 18, "held_out": 6, "quarantined": 0, "copies": 0} == metrics["pushes"]
    assert len(json.loads(one["held_out_actions.json"])) == 6
    assert len(json.loads(one["curve.json"])["loss"]) == 3
    assert read_push_model(folder / "one").facts.contexts == (("foam", "ball"),)
    assert read_image(folder / "one" / "held_out.png").shape[1] == 4 * 60 + 9
