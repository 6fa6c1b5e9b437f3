"""Models that DVC keeps are logged models: no bytes, DVC's hash, figures on named data, and links to run and bundle."""

import os
from pathlib import Path
from typing import Any

import pytest

from pipelines._review.agreement import link
from pipelines._review.champions import register
from pipelines._review.history import History
from pipelines._review.models import MODEL
from pipelines._tracking import input_digests, tracked_run
from pipelines._tracking.store import VARIABLE

MODEL_PATH = "models/stroke_marker/weights"


@pytest.fixture
def client(stage_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """An execution that trained a model on strokes and put it into a bundle, and DVC's lock of both."""
    from mlflow import MlflowClient

    Path("dvc.yaml").write_text("stages: {diagnose_gap: {matrix: {tool: [marker]}}, deploy: {cmd: x}}\n")
    Path("params.yaml").write_text("diagnose_gap: {seed: 1}\ndeploy: {}\n")
    Path("data").mkdir()
    Path("data/strokes").write_text("strokes")
    Path(MODEL_PATH).mkdir(parents=True)
    strokes, weights = input_digests({"it": Path("data/strokes")})["it"], "c" * 32 + ".dir"
    monkeypatch.setenv(VARIABLE, "first")
    with tracked_run("diagnose_gap", "marker", {"seed": 1}, {"strokes": Path("data/strokes")}) as run:
        run.log_metrics({"held_out": {"extended": {"mse": 0.25}, "base": {"mse": 0.5}}})
        run.log_items("held_out.extended.mse", ["a", "b"], [0.2, 0.3])
    lock = [
        "stages:",
        "  deploy:",
        f"    deps: [{{path: {MODEL_PATH}, md5: {weights}}}]",
        "    params: {params.yaml: {deploy: {}}}",
        f"    outs: [{{path: models/bundle, md5: {'b' * 32}}}]",
        "  diagnose_gap@marker:",
        f"    deps: [{{path: data/strokes, md5: {strokes}}}]",
        "    params: {params.yaml: {diagnose_gap: {seed: 1}}}",
        f"    outs: [{{path: data/gap, md5: aa}}, {{path: {MODEL_PATH}, md5: {weights}}}]",
    ]
    Path("dvc.lock").write_text("\n".join(lock) + "\n")
    with tracked_run("deploy", None, {}, {"stroke_marker": Path(MODEL_PATH)}) as run:
        run.log_metrics({"largest_difference": 1e-6})
        run.tag("manifest", "hash")
    link(Path.cwd(), "first", "FINISHED")
    store = os.environ["MLFLOW_TRACKING_URI"]
    return MlflowClient(store, store)  # not the store that another test's logger has made MLflow's default


def test_a_model_leads_to_its_files_figures_data_run_and_bundle(client: Any) -> None:
    bundled, trained = History().runs
    model = client.get_logged_model(trained.tags[f"{MODEL}{MODEL_PATH}"])
    bundle = client.get_logged_model(bundled.tags[f"{MODEL}models/bundle"])
    assert (model.name, model.source_run_id, str(model.status)) == ("stroke_marker", trained.id, "READY")
    assert model.tags["dvc"] == f"dvc://{'c' * 32}.dir/{MODEL_PATH}" and model.params == {"seed": "1"}
    assert bundle.tags["manifest"] == "hash"
    figures = {figure.key: figure for figure in model.metrics}
    assert set(figures) == {"held_out.extended.mse", "held_out.base.mse"}
    figure = figures["held_out.extended.mse"]
    assert (figure.value, figure.dataset_name, figure.dataset_digest) == (
        0.25,
        "strokes",
        trained.inputs["data/strokes"],
    )
    text = model.tags["mlflow.note.content"]
    assert f"#/experiments/{model.experiment_id}/runs/{trained.id}" in text
    assert f"Part of [models/bundle](#/experiments/{bundle.experiment_id}/models/{bundle.model_id})" in text
    assert (
        f"[{MODEL_PATH}](#/experiments/{model.experiment_id}/models/{model.model_id})"
        in bundle.tags["mlflow.note.content"]
    )
    stored = client.get_run(trained.id)
    assert [each.model_id for each in stored.outputs.model_outputs] == [model.model_id]
    assert [each.model_id for each in client.get_run(bundled.id).inputs.model_inputs] == [model.model_id]
    assert len(client.get_metric_history(trained.id, "held_out.extended.mse")) == 1  # logged once, though for two
    assert not client.list_logged_model_artifacts(model.model_id)


def test_each_model_is_logged_once_and_its_version_knows_it(client: Any) -> None:
    before = [run.tags for run in History().runs]
    link(Path.cwd(), "first", "FINISHED")
    assert [run.tags for run in History().runs] == before
    assert len(register(Path.cwd())) == 2
    version = client.get_model_version_by_alias("stroke_marker", "champion")
    logged = before[1][f"{MODEL}{MODEL_PATH}"]
    assert version.tags["logged_model"] == logged
    registered = client.get_logged_model(logged).tags["mlflow.modelVersions"]
    assert registered == '[{"name": "stroke_marker", "version": 1}]'
    assert version.source == f"dvc://{'c' * 32}.dir/{MODEL_PATH}"
