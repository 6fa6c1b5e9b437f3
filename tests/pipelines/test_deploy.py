"""The stage deploy: from folders of models to a bundle that opens, and a run that is found by its manifest's hash."""

import argparse
import hashlib
import json
import shutil
from dataclasses import asdict
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from pentimento.bundle.reader import BundleError, open_bundle
from pentimento.contracts.codec import to_plain
from pentimento.contracts.errors import ContractError
from pentimento.deploy.bundle import DeployConfig, Models
from pentimento.deploy.graphs import ParityError
from pentimento.dynamics.pushes.push_model import write_push_model
from pentimento.dynamics.strokes.extended import model_files
from pentimento.planning.pushes.analytic.correction import FILE, correction_as_json
from pentimento.planning.strokes.latent import write_decoder
from pipelines import deploy
from pipelines._tracking import input_digests
from pipelines._tracking.families import experiment_of
from tests.deploy.bundles import CONFIG, small_bundle

pytestmark = pytest.mark.timeout(1200)  # the first test exports everything


@pytest.fixture
def folder(stage_folder: Path) -> Path:
    """Models and params.yaml; the export itself is made once for all tests."""
    _, models = small_bundle()
    weights = stage_folder / "models/stroke_marker/weights"
    weights.mkdir(parents=True)
    for name, value in model_files(models.strokes["marker"]).items():
        (weights / name).write_text(json.dumps(value))
    clay = stage_folder / "models/push_foam/weights"
    clay.mkdir(parents=True)
    write_push_model(models.pushes["foam"], clay)
    (clay / FILE).write_text(json.dumps(correction_as_json(models.corrections["foam"])))
    shutil.copytree(models.encoder_folder, stage_folder / "semantics")
    shutil.copytree(models.goal_folder, stage_folder / "goal")
    for name, decoder in models.hands.items():
        write_decoder(stage_folder / f"hands/hands/{name}.npz", decoder)
    YAML(typ="safe").dump({"deploy": to_plain(CONFIG)}, Path("params.yaml"))
    return stage_folder


def run() -> Path:
    deploy.main(
        argparse.Namespace(
            models=Path("models"),
            tools=["marker"],
            materials=["foam"],
            semantics=Path("semantics"),
            goal=Path("goal"),
            hands=Path("hands"),
            out=Path("bundle"),
        )
    )
    return Path("bundle")


def test_the_stage_hands_models_and_settings_on_and_tags_its_run(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from mlflow import MlflowClient

    given: list[tuple[Models, DeployConfig]] = []

    def copied(out: Path, models: Models, config: DeployConfig) -> None:
        given.append((models, config))
        shutil.copytree(small_bundle()[0], out, dirs_exist_ok=True)

    monkeypatch.setattr(deploy, "write_bundle", copied)
    out = run()
    models, config = given[0]
    assert config == CONFIG
    assert asdict(models.strokes["marker"].parameters) == asdict(small_bundle()[1].strokes["marker"].parameters)
    assert models.pushes["foam"].facts == small_bundle()[1].pushes["foam"].facts
    assert models.corrections["foam"].covariates == small_bundle()[1].corrections["foam"].covariates
    assert models.encoder.digest == small_bundle()[1].encoder.digest
    assert models.digests["semantics"] == input_digests({"it": Path("semantics")})["it"]
    assert set(models.digests) == {"stroke_marker", "push_foam", "semantics", "goal", "hands"}
    assert {name: hand.hand for name, hand in models.hands.items()} == {"anna": "anna", "arcs": "arcs"}
    client = MlflowClient(f"sqlite:///{folder / 'mlflow.db'}")
    experiment = client.get_experiment_by_name(experiment_of("deploy"))
    assert experiment is not None
    (tracked,) = client.search_runs([experiment.experiment_id])
    assert tracked.data.tags["manifest"] == open_bundle(out).digest
    assert tracked.data.tags["manifest"] == hashlib.sha256((out / "manifest.json").read_bytes()).hexdigest()
    assert tracked.data.metrics["largest_difference"] <= CONFIG.tolerance


def test_a_bundle_that_the_runner_would_refuse_is_not_handed_on(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def spoilt(out: Path, _models: Models, _config: DeployConfig) -> None:
        shutil.copytree(small_bundle()[0], out, dirs_exist_ok=True)
        (out / "more.txt").write_text("")

    monkeypatch.setattr(deploy, "write_bundle", spoilt)
    with pytest.raises(BundleError, match="does not list"):
        run()
    assert not Path("bundle").exists()


def test_a_folder_without_hands_is_refused(folder: Path) -> None:
    shutil.rmtree(folder / "hands/hands")
    with pytest.raises(ContractError, match="hands/hands holds no hand"):
        run()


def test_a_graph_beyond_its_tolerance_fails_the_stage(folder: Path) -> None:
    YAML(typ="safe").dump({"deploy": to_plain(CONFIG) | {"tolerance": 1e-12}}, Path("params.yaml"))
    with pytest.raises(ParityError, match="the tolerance of 1e-12"):
        run()
    assert not Path("bundle").exists()
