"""The stage diagnose_gap: a table of strokes becomes a verdict, an extended model, and a run for each candidate."""

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from pentimento.contracts.errors import ContractError
from pentimento.contracts.strokes import CONTRACT, example_table
from pentimento.contracts.tables import write_table
from pentimento.diagnosis.evidence import Evidence
from pentimento.diagnosis.rule import DEFAULT_RULE
from pentimento.dynamics.strokes.extended import read_stroke_model
from pentimento.dynamics.strokes.mechanisms import VOCABULARY
from pentimento.dynamics.strokes.samples import load_samples
from pentimento.dynamics.strokes.training import TrainingConfig, train
from pentimento.dynamics.strokes.traj2stroke import read_parameters
from pipelines._imports import ROOT
from pipelines._params import read_params
from pipelines._tracking.families import experiment_of
from pipelines.diagnose_gap import main
from tests.pipelines.conftest import Enter

HELD_OUT = list(range(0, 72, 5))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Example strokes, which fade with the ink used since the last dip, and a base trained on most of them."""
    place = tmp_path_factory.mktemp("stage")
    params = read_params(ROOT / "params.yaml")
    params["diagnose_gap"]["joint_fit"] |= {"epochs": 12, "path_points": 16, "pixels_per_m": 1000}
    YAML(typ="safe").dump({"diagnose_gap": params["diagnose_gap"]}, place / "params.yaml")
    table = example_table(72)
    write_table(place / "strokes", table, CONTRACT, "# Card")
    samples = load_samples(table, 16, 1000.0, 0.012)
    config = TrainingConfig(16, 1000.0, 0.012, 25, 16, 0.05, 2.0, 0.25, 0)
    base = train(samples, config, lambda *_: None).parameters_si()
    (place / "base").mkdir()
    (place / "base/parameters.json").write_text(json.dumps(asdict(base)))
    (place / "base/held_out_actions.json").write_text(json.dumps(HELD_OUT))
    return place


@pytest.fixture(scope="module")
def client(folder: Path, enter: Enter) -> Any:
    """After the stage ran once."""
    from mlflow import MlflowClient

    with pytest.MonkeyPatch.context() as patch:
        enter(folder, patch)
        main(arguments(folder))
        yield MlflowClient()


def arguments(folder: Path) -> argparse.Namespace:
    paths = {name: folder / name for name in ("strokes", "base", "gap", "out")}
    return argparse.Namespace(tool="round_brush", **paths)


def test_what_is_established_extends_the_model(client: Any, folder: Path) -> None:
    verdict = json.loads((folder / "gap/verdict.json").read_text())
    assert [entry["cause"] for entry in verdict["established"]] == ["ink_depletion"]
    model = read_stroke_model(folder / "out")
    (mechanism,) = model.mechanisms
    assert mechanism.cause == "ink_depletion" and float(mechanism.values[0]) > 0
    assert list(model.fitted) == ["ink_since_reload_m"]
    metrics = json.loads((folder / "out/metrics.json").read_text())
    assert metrics["established"] == 1 and metrics["joint_fit"]["kept"]
    assert metrics["held_out"]["extended"]["mse"] < metrics["held_out"]["base"]["mse"]
    assert metrics["mse"]["extended"] < metrics["mse"]["base"] == pytest.approx(verdict["mse"]["base"])
    assert model.parameters != read_parameters(folder / "base/parameters.json")


def test_each_candidate_is_a_run_below_the_diagnosis(client: Any, folder: Path) -> None:
    experiment = client.get_experiment_by_name(experiment_of("diagnose_gap")).experiment_id
    runs = client.search_runs([experiment], max_results=100)
    (parent,) = (run for run in runs if "mlflow.parentRunId" not in run.data.tags)
    children = {
        run.data.tags["cause"]: run for run in runs if run.data.tags.get("mlflow.parentRunId") == parent.info.run_id
    }
    assert set(children) >= {kind.cause for kind in VOCABULARY}
    assert all(run.info.status == "FINISHED" for run in runs)
    found = children["ink_depletion"]
    assert found.data.tags["verdict"] == "established"
    assert set(found.data.metrics) == {"probability", "gain", "gain_low", "gain_high", *Evidence._fields}
    assert found.data.metrics["probability"] >= DEFAULT_RULE.established and found.data.metrics["gain_low"] > 0
    assert {run.data.tags["verdict"] for run in children.values()} >= {"established", "not established"}
    others = [run for run in children.values() if run.data.tags["verdict"] == "not established"]
    assert all(set(run.data.metrics) == {"p", "gain"} for run in others)
    unseen = [run for run in children.values() if run.data.tags["verdict"] == "not observable"]
    assert all(run.data.tags["reason"] for run in unseen)


def test_a_base_of_other_strokes_is_a_sentence(client: Any, folder: Path, tmp_path: Path) -> None:
    (tmp_path / "base").mkdir()
    (tmp_path / "base/held_out_actions.json").write_text("[4000]")
    (tmp_path / "base/parameters.json").write_text((folder / "base/parameters.json").read_text())
    given = arguments(folder)
    given.base, given.gap, given.out = tmp_path / "base", tmp_path / "gap", tmp_path / "out"
    with pytest.raises(ContractError, match="train the base on them"):
        main(given)
    assert not given.out.exists() and not given.gap.exists()
