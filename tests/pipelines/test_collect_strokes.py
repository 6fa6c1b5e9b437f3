"""Tests of the stage collect_strokes."""

import argparse
import json
from pathlib import Path

import pytest
from ruamel.yaml import YAML

import pipelines.collect_strokes as stage
from pentimento.contracts.errors import PentimentoError
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pipelines._imports import ROOT
from pipelines._params import read_params


@pytest.fixture
def folder(stage_folder: Path) -> Path:
    section = read_params(ROOT / "params.yaml")["collect_strokes"]
    section["collection"] |= {"strokes": 12, "repeated": 1, "times": 2, "pixels_per_m": 1000}
    YAML(typ="safe").dump({"collect_strokes": section}, stage_folder / "params.yaml")
    return stage_folder


def test_largest_aliasing_is_a_metric_of_the_strokes(folder: Path) -> None:
    from mlflow import MlflowClient

    stage.main(argparse.Namespace(tool="round_brush", out=folder / "strokes"))
    metrics = json.loads((folder / "strokes/metrics.json").read_text())
    assert metrics["rows"] == 12 == read_table(folder / "strokes", CONTRACT).table.num_rows
    assert 0 < metrics["largest_aliasing"] <= 1
    (run,) = MlflowClient().search_runs(
        [experiment.experiment_id for experiment in MlflowClient().search_experiments()]
    )
    assert run.data.metrics["largest_aliasing"] == pytest.approx(metrics["largest_aliasing"])


def test_prints_aliased_causes_before_any_stroke(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class RobotError(PentimentoError): ...

    def power_cut(*_: object) -> None:
        raise RobotError("no power")

    monkeypatch.setattr(stage, "collect_strokes", power_cut)
    with pytest.raises(RobotError, match="no power"):
        stage.main(argparse.Namespace(tool="round_brush", out=folder / "strokes"))
    assert "cannot distinguish: " in capsys.readouterr().err
    assert not (folder / "strokes").exists()
