"""The stage plan_painting: its settings, and a plan with a model of known width."""

import argparse
import json
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from pentimento.contracts.errors import ConfigError
from pentimento.contracts.images import read_image
from pentimento.contracts.plan import read_plan
from pentimento.contracts.strokes import CONTRACT, example_table
from pentimento.contracts.tables import write_table
from pentimento.dynamics.strokes.extended import base_model, model_files
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from pipelines._imports import ROOT
from pipelines._params import read_params, read_yaml, resolved
from pipelines.plan_painting import main

PEN = {"preset": "planners.small_pen", "iterations_per_round": 4, "iterations_free": 8, "pixels_per_m": 1000}
SETTING = {
    "file": "marker", "photograph": "chelsea", "darkest": 0.35, "canvas_m": ["60 mm", "40 mm"], "strokes": 8,
    "planner": PEN,
}  # fmt: skip


def planned(folder: Path, **changed: Any) -> Path:
    """The folder of a plan with a pen 2 mm wide."""
    document = read_yaml(ROOT / "params.yaml")
    document["plan_painting"]["tools"] = {"pen": SETTING | changed}
    YAML(typ="safe").dump({"plan_painting": resolved(document)["plan_painting"]}, folder / "params.yaml")
    assert read_params(folder / "params.yaml")
    if not (folder / "strokes").exists():
        write_table(folder / "strokes", example_table(2), CONTRACT, "# Two strokes")
        (folder / "model").mkdir()
        pen = base_model(Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 0.01, 0.001, 0.2, 0.95))
        for name, content in model_files(pen).items():
            (folder / "model" / name).write_text(json.dumps(content))
    main(argparse.Namespace(tool="pen", strokes=folder / "strokes", model=folder / "model", out=folder / "plan"))
    return folder / "plan"


def test_the_plan_is_closer_to_its_target_than_the_blank_sheet(stage_folder: Path) -> None:
    out = planned(stage_folder)
    metrics = json.loads((out / "metrics.json").read_text())
    plan = read_plan(out / "plan.jsonl")
    assert 0 < metrics["strokes"] == len(plan.strokes) <= 8
    assert metrics["error"]["plan"] < metrics["error"]["blank"]
    assert plan.header.canvas_size_m == pytest.approx((0.06, 0.04))
    assert read_image(out / "plan.png").shape == read_image(out / "target.png").shape == (40, 60, 3)
    assert read_image(out / "plan.png").min() < 128 and json.loads((out / "warnings.json").read_text()) == []


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"canvas_m": [0.0, 0.04]}, r"canvas_m is \[0\.0, 0\.04\]; both sides must be above 0"),
        ({"darkest": 1.0}, r"darkest is 1\.0; it must be below 1"),
        ({"strokes": 0}, r"strokes is 0; it must be 1 or more"),
    ],
)
def test_a_setting_out_of_its_range_is_one_sentence(stage_folder: Path, changed: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigError, match=rf"plan_painting\.tools\.pen: {sentence}"):
        planned(stage_folder, **changed)
