"""The main figures of an experiment as the shared view of MLflow's page."""

import base64
import json
import zlib
from pathlib import Path

import pytest

from pipelines._review.history import History
from pipelines._review.view import KEY, address_of, share_view, view_of
from pipelines._tracking.store import open_store
from tests.pipelines.history import execute, repository

NOTE = "mlflow.note.content"
MODEL = "train_stroke_dynamics/marker/held_out.model.mse"
POLYLINE = "train_stroke_dynamics/marker/held_out.polyline.mse"


def test_each_main_figure_stands_beside_its_baseline_and_has_a_chart() -> None:
    state = view_of([POLYLINE, MODEL, "train_stroke_dynamics/marker/epochs", "paint/colour/error.with_replanning"])
    assert state["selectedColumns"] == [
        "attributes.`Created`",
        f"metrics.`{MODEL}`",
        f"metrics.`{POLYLINE}`",
        "metrics.`paint/colour/error.with_replanning`",
    ]
    charts = state["compareRunCharts"]
    assert [chart["metricKey"] for chart in charts] == [MODEL, "paint/colour/error.with_replanning"]
    (section,) = state["compareRunSections"]
    assert {chart["metricSectionId"] for chart in charts} == {section["uuid"]}
    assert len({chart["uuid"] for chart in charts}) == len(charts)


def test_an_execution_shares_the_view_of_its_experiment(stage_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    repository(stage_folder)
    execute("one", 3, 0.3, monkeypatch, ("train_stroke_dynamics",))
    (parent,) = History().executions[0].ids
    client = open_store()
    experiment = client.get_experiment(client.get_run(parent).info.experiment_id)
    kind, packed = experiment.tags[f"mlflow.sharedViewState.{KEY}"].split(";")
    assert kind == "deflate"
    assert json.loads(zlib.decompress(base64.b64decode(packed))) == view_of([MODEL, POLYLINE])


def test_the_description_has_the_link_unless_a_person_wrote_it(
    stage_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    repository(stage_folder)
    experiment = None
    for name in ("one", "two"):
        execute(name, 3, 0.3, monkeypatch, ("train_stroke_dynamics",))
        client = open_store()
        experiment = client.get_experiment_by_name("pentimento/strokes")
        assert experiment.tags[NOTE].count(f"]({address_of(experiment.experiment_id)})") == 1
    client.set_experiment_tag(experiment.experiment_id, NOTE, "Mine.")
    share_view(client, experiment.experiment_id, [MODEL])
    assert client.get_experiment(experiment.experiment_id).tags[NOTE] == "Mine."
