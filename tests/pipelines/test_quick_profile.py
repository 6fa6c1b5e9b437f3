"""`make repro PROFILE=quick`: its pipeline and its settings agree with each other and with the default pipeline."""

from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from pentimento.copainting.drawings.sources import nouns_of
from pentimento.report.page import ReportConfig
from pipelines._config import load_section
from pipelines._imports import ROOT
from pipelines._params import overlaid, read_yaml, resolved, sections_of
from pipelines._side_by_side import in_order
from pipelines.collect_strokes import CollectStrokes
from pipelines.diagnose_gap import DiagnoseGap
from pipelines.duet import Duet
from pipelines.paint import Paint

PIPELINE = read_yaml(ROOT / "profiles/quick/pipeline.yaml")
STAGES: dict[str, dict[str, Any]] = PIPELINE["stages"]


@pytest.fixture
def params(tmp_path: Path) -> Path:
    """params.yaml of the profile."""
    path = tmp_path / "params.yaml"
    with path.open("w", encoding="utf-8") as file:
        YAML(typ="safe").dump(resolved(overlaid(ROOT, "quick")), file)
    return path


def test_its_stages_are_those_of_the_default_pipeline() -> None:
    """Outputs and commands: only the goal planner of the duet and what the report shows differ."""
    default = read_yaml(ROOT / "dvc.yaml")["stages"]
    for name, stage in STAGES.items():
        assert stage["outs"] == default[name]["outs"]
        assert stage["params"] == sections_of(name, overlaid(ROOT, "quick"))
        if name not in ("duet", "report"):
            assert stage["cmd"] == default[name]["cmd"]
    assert STAGES["duet"]["cmd"] == default["duet"]["cmd"].replace("models/goal_planner/weights", "base/weights/goal")


def test_painting_and_duet_use_the_tool_that_is_diagnosed(params: Path) -> None:
    (tools,) = (each["tools"] for each in PIPELINE["vars"] if isinstance(each.get("tools"), list))
    painted, duet = load_section(params, "paint", Paint), load_section(params, "duet", Duet)
    assert {painted.settings["colour"].tool, duet.setting.medium.tool} == set(tools)
    assert load_section(params, "diagnose_gap", DiagnoseGap).rounds == 0
    collection = load_section(params, "collect_strokes", CollectStrokes).collection
    assert collection.repeated * collection.times < collection.strokes, "some strokes are made once"


def test_the_person_draws_and_asks_for_what_the_base_was_taught(params: Path) -> None:
    known = nouns_of("openmoji")
    for turn in load_section(params, "duet", Duet).turns:
        assert turn.draws is None or turn.draws.noun in known
        assert turn.asks.removeprefix("a ") in known


def test_the_report_says_what_was_made_and_what_the_default_adds(params: Path) -> None:
    note = load_section(params, "report", ReportConfig).note
    assert note is not None and note.startswith("This is the quick profile") and "make repro" in note
    assert "\n" not in note


def test_painting_and_duet_can_run_at_once() -> None:
    reads = {name: _read_by(stage) for name, stage in STAGES.items()}
    assert "duet" not in reads["paint"] and "paint" not in reads["duet"]
    assert in_order(reads)[:3] == ["collect_strokes", "train_stroke_dynamics", "diagnose_gap"]
    assert in_order(reads)[-1] == "report"


def _read_by(stage: dict[str, Any]) -> frozenset[str]:
    """The stages that write what a stage depends on; the tool stands for `${item.tool}`."""
    made = {out.replace("${item.tool}", "round_brush"): name for name, each in STAGES.items() for out in each["outs"]}
    deps = (dep.replace("${item.tool}", "round_brush") for dep in stage["deps"])
    return frozenset(made[dep] for dep in deps if dep in made)
