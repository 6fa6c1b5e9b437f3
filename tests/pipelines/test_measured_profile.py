"""`make repro PROFILE=measured`: its pipeline, its settings, and all its stages on a few recorded strokes."""

import argparse
import os
import subprocess
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML

from pentimento.contracts.errors import ConfigError
from pentimento.contracts.plan import read_plan
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table, write_table
from pentimento.dynamics.strokes.samples import load_samples
from pipelines._config import load_section
from pipelines._imports import ROOT
from pipelines._params import overlaid, read_params, read_yaml, resolved, sections_of
from pipelines.collect_strokes import main as collect
from pipelines.plan_painting import PlanPainting
from pipelines.report import main as report

VARIABLE = "PENTIMENTO_MEASURED"
MEASURED = os.environ.get(VARIABLE)
PIPELINE = read_yaml(ROOT / "profiles/measured/pipeline.yaml")
TOOLS = ("big_brush",)
STROKES = 40


def test_without_the_folder_one_sentence_says_what_to_set(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    from pipelines._repro import main

    monkeypatch.chdir(ROOT)
    for name in ("MLFLOW_TRACKING_URI", "PENTIMENTO_PROFILE"):
        monkeypatch.setenv(name, "unused")
    monkeypatch.delenv(VARIABLE, raising=False)
    assert main(["measured"]) == 1
    (sentence,) = capfd.readouterr().err.splitlines()
    assert f"set the environment variable {VARIABLE}" in sentence and "profiles/measured.yaml" in sentence


def test_a_profile_may_name_environment_variables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "profiles").mkdir()
    (tmp_path / "params.yaml").write_text("collect: {source: {}, sizes: [a]}\n")
    (tmp_path / "profiles/mine.yaml").write_text("collect: {source: {pen: '${HERE}/a.parquet'}, sizes: ['${HERE}']}\n")
    monkeypatch.setenv("HERE", "/data")
    assert overlaid(tmp_path, "mine") == {"collect": {"source": {"pen": "/data/a.parquet"}, "sizes": ["/data"]}}
    monkeypatch.delenv("HERE")
    with pytest.raises(ConfigError, match="set the environment variable HERE"):
        overlaid(tmp_path, "mine")


def test_its_stages_are_those_of_the_default_pipeline() -> None:
    """Commands and outputs: only what the report shows differs."""
    default = read_yaml(ROOT / "dvc.yaml")["stages"]
    for name, stage in PIPELINE["stages"].items():
        assert stage["outs"] == default[name]["outs"]
        if name != "report":
            assert stage["cmd"] == default[name]["cmd"]


def test_its_pipeline_and_its_settings_name_the_same_tools(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "/recordings")
    params = overlaid(ROOT, "measured")
    (tools,) = (each["tools"] for each in PIPELINE["vars"] if "tools" in each)
    assert set(params["collect_strokes"]["source"]) == set(params["plan_painting"]["tools"]) == set(tools)
    for name, stage in PIPELINE["stages"].items():
        assert stage["params"] == sections_of(name, params)


@pytest.mark.skipif(not MEASURED, reason=f"{VARIABLE} does not name a folder of recorded strokes")
@pytest.mark.timeout(600)
def test_from_recorded_strokes_to_the_report(stage_folder: Path) -> None:
    """Every stage on a few strokes of a brush, with few epochs."""
    params = resolved(overlaid(ROOT, "measured"))
    for tool in TOOLS:
        table = read_table(Path(params["collect_strokes"]["source"][tool]), CONTRACT).table.slice(0, STROKES)
        write_table(stage_folder / "recorded" / tool, table, CONTRACT, "# Some strokes")
        params["collect_strokes"]["source"][tool] = str(stage_folder / "recorded" / tool)
        planned: dict[str, Any] = params["plan_painting"]["tools"][tool]
        planned |= {"file": str(ROOT / planned["file"]), "strokes": 12}
        planned["planner"] |= {"rounds": 1, "iterations_per_round": 4, "iterations_free": 4}
    small = {"epochs": 3, "pixels_per_m": 1000.0}
    params["train_stroke_dynamics"] |= small
    params["diagnose_gap"]["joint_fit"] |= small
    params["report"]["strokes"] |= {"pixels_per_m": 1000.0, "shown": 2}
    YAML(typ="safe").dump(params, stage_folder / "params.yaml")
    assert read_params(stage_folder / "params.yaml")["plan_painting"] == params["plan_painting"]
    for tool in TOOLS:
        _run(tool)
        plan = read_plan(Path("data/plans", tool, "plan.jsonl"))
        half_sheet = np.array(load_section(Path("params.yaml"), "plan_painting", PlanPainting).tools[tool].canvas_m) / 2
        assert plan.header.tool == tool
        for stroke in plan.strokes:
            assert (np.abs(stroke.path[:, 1:3] - half_sheet) <= half_sheet).all()
    report(_arguments("report", tools=[*TOOLS], planned=[*TOOLS]))
    page = Path("data/report/index.html").read_text()
    for words in ("What the recorded tools do", "cannot decide, and why", "Nobody has executed this plan", "big brush"):
        assert words in page
    assert "speed_width" in page and "the paths have no times" in page
    assert str(MEASURED) not in page and "Co-painting" not in page and "Sculpting" not in page


@pytest.mark.skipif(not MEASURED, reason=f"{VARIABLE} does not name a folder of recorded strokes")
def test_pairs_of_pictures_are_collected_with_the_ink_along_the_paths(stage_folder: Path) -> None:
    params = resolved(overlaid(ROOT, "measured"))
    YAML(typ="safe").dump({"collect_strokes": params["collect_strokes"]}, stage_folder / "params.yaml")
    (tool,) = params["collect_strokes"]["pairs"]
    collect(_arguments("collect_strokes", tool=tool))
    table = read_table(Path("data/strokes", tool), CONTRACT).table
    assert set(table["frame"].to_pylist()) == {"stroke"} and table.num_rows > 50
    samples = load_samples(table, 16, pixels_per_m=1000.0, margin_m=0.012)
    inked = samples.ink.flatten(1).any(dim=1)
    assert inked.float().mean() > 0.9  # ink is that which touches a path


def _run(tool: str) -> None:
    for stage in ("collect_strokes", "train_stroke_dynamics", "diagnose_gap", "plan_painting"):
        import_module(f"pipelines.{stage}").main(_arguments(stage, tool=tool))


def _arguments(stage: str, **values: Any) -> argparse.Namespace:
    """The options of a stage in the profile's pipeline, with these values; those that it does not use are empty."""
    words = PIPELINE["stages"][stage]["cmd"].replace("${item.tool}", str(values.get("tool"))).split()[3:]
    words = [word for word in words if word != "${reported}"]
    if stage == "report":
        none = ("paintings", "meanings", "evaluations", "duet", "performances", "sculptures", "hands", "subjects")
        values |= dict.fromkeys((*none, "demonstrations", "benchmarks"))
        values |= {name: [] for name in ("settings", "evaluated", "drawn", "sculpted")}
    paths = dict(zip(words[::2], words[1::2], strict=True))
    return argparse.Namespace(**{name.removeprefix("--"): Path(path) for name, path in paths.items()} | values)


def test_recordings_are_not_in_the_repository() -> None:
    listed = subprocess.run(["git", "ls-files", "*.parquet", "*.npz"], cwd=ROOT, capture_output=True, text=True)
    assert not [file for file in listed.stdout.splitlines() if file.startswith(("profiles", "data"))]
