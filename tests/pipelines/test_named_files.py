"""Files that params.yaml names are dependencies of their stage; `make clean` removes outputs and nothing else."""

import re
from pathlib import Path

import pytest

from pipelines._clean import clean
from pipelines._deps import name_files
from pipelines._imports import ROOT
from pipelines._params import read_yaml
from pipelines._progress_views import View
from pipelines._repro import main, overlay
from pipelines._side_by_side import Outcome
from pipelines._tracking.dvc_files import outputs
from pipelines._tracking.run import _warn_of_unnoticed_files

DVC = """\
vars:
  - tools: &tools [marker, round_brush]
stages:
  gather:
    cmd: python -m pipelines.gather --out data/demonstrations
    deps:
      - pipelines/gather.py
      - data/known
    params: [gather]
    outs:
      - data/demonstrations
  collect:
    matrix:
      tool: ${tools}
    cmd: python -m pipelines.collect --out data/strokes/${item.tool}
    deps:
      - pipelines/collect.py
    params: [collect, presets]
    outs:
      - data/strokes/${item.tool}
"""
PARAMS = """\
gather:
  sources:
    - {path: recordings/a b.csv, format: tablet, hand: marker}
    - {path: /outside/of/it.json, format: tablet, hand: "recordings/a b.csv"}
  known: data/known
  made: data/demonstrations/part
collect:
  source: {marker: data/mine, round_brush: ./take.csv}
  world: recordings
  preset: presets.photograph
presets: {photograph: {picture: goal.png}}
"""


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in (
        "recordings/a b.csv",
        "data/known/x",
        "data/mine/part",
        "take.csv",
        "goal.png",
        "data/demonstrations/part",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("x")
    (tmp_path / "dvc.yaml").write_text(DVC)
    (tmp_path / "params.yaml").write_text(PARAMS)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def dependencies(stage: str) -> list[str]:
    return read_yaml(Path("dvc.yaml"))["stages"][stage]["deps"]


def test_files_that_params_name_are_dependencies_of_their_stage(project: Path) -> None:
    assert name_files(project)
    assert dependencies("gather") == ["recordings/a b.csv", "pipelines/gather.py", "data/known"]
    # A single word is no folder, and presets count.
    assert dependencies("collect") == ["data/mine", "take.csv", "goal.png", "pipelines/collect.py"]
    text = (project / "dvc.yaml").read_text()
    assert not name_files(project) and (project / "dvc.yaml").read_text() == text
    (project / "params.yaml").write_text(PARAMS.replace("data/mine", "data/other").replace("goal.png", "gone.png"))
    assert name_files(project)
    assert dependencies("collect") == ["take.csv", "pipelines/collect.py"]
    (project / "params.yaml").write_text("gather: {}\ncollect: {}\n")
    assert name_files(project) and (project / "dvc.yaml").read_text() == DVC


def test_make_repro_names_files_before_dvc_looks(
    project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    seen: list[list[str]] = []

    def looked(folder: Path, _view: View, _targets: list[str]) -> Outcome:
        seen.append(dependencies("collect"))
        return Outcome(1, frozenset())

    monkeypatch.setattr("pipelines._repro.bring_up_to_date", looked)
    monkeypatch.setattr("pipelines._repro.link", lambda *_: None)
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "unused")
    monkeypatch.setenv("PENTIMENTO_PROFILE", "unused")
    monkeypatch.setenv("PENTIMENTO_EXECUTION", "unused")
    assert main([]) == 1 and "data/mine" in seen[0]
    assert "as dependencies" in capsys.readouterr().out
    (project / "dvc.yaml").write_text("stages: [")  # which DVC reports
    monkeypatch.setattr("pipelines._repro.bring_up_to_date", lambda *_: Outcome(1, frozenset()))
    assert main([]) == 1


def test_a_stage_says_which_files_dvc_would_not_notice(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _warn_of_unnoticed_files("collect")
    assert "collect: dvc.yaml does not list data/mine, take.csv, goal.png" in capsys.readouterr().err
    name_files(project)
    _warn_of_unnoticed_files("collect")
    _warn_of_unnoticed_files("unknown")
    assert capsys.readouterr().err == ""


def test_clean_removes_what_the_pipeline_makes_and_leaves_what_was_brought(project: Path) -> None:
    made = [
        "data/strokes/marker/p",
        "data/strokes/round_brush/p",
        "data/timings/t.json",
        "data/comparisons/c.html",
        "models/old/weights/w",
    ]
    brought = ["data/mine/part", "data/strokes/mine/p", "models/mine/weights/w", "data/README.md", "recordings/a b.csv"]
    for name in made + brought:
        (project / name).parent.mkdir(parents=True, exist_ok=True)
        (project / name).write_text("x")
    (project / "dvc.lock").write_text("stages: {train@old: {cmd: x, outs: [{path: models/old/weights}]}}\n")
    expected = ["data/demonstrations", "data/strokes/marker", "data/strokes/round_brush", "models/old/weights"]
    assert outputs(project) == expected
    clean(project)
    assert [name for name in made if (project / name).exists()] == []
    assert all((project / name).is_file() for name in brought)
    assert not (project / "models/old").exists() and not (project / "data/timings").exists()
    clean(project)


def test_the_makefile_removes_no_data_by_a_pattern() -> None:
    recipe = re.search(r"(?m)^clean:.*\n((?:\t.*\n)+)", (ROOT / "Makefile").read_text())
    assert recipe is not None and "pipelines._clean" in recipe[1]
    assert not re.search(r"\brm .*(data|models|\*)", recipe[1])
    declared = outputs(ROOT)
    assert (
        "data/strokes/marker" in declared and "models/bundle" in declared and not any("$" in path for path in declared)
    )


def test_a_profile_names_its_own_files(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pipelines._repro._copy_changed", lambda root, folder: None)
    (project / "profiles").mkdir()
    (project / "profiles/mine.yaml").write_text("collect: {world: goal.png}\n")
    folder = project / ".profiles/mine"
    (folder / ".dvc").mkdir(parents=True)
    for name in ("goal.png", "take.csv"):
        (folder / name).write_text("x")
    (folder / "dvc.yaml").write_text(DVC)
    assert overlay(project, "mine") == folder
    assert name_files(folder)
    assert read_yaml(folder / "dvc.yaml")["stages"]["collect"]["deps"][:2] == ["take.csv", "goal.png"]
    assert (project / "dvc.yaml").read_text() == DVC
