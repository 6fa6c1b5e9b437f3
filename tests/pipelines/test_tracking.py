import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pentimento.contracts.errors import PentimentoError
from pentimento.contracts.images import write_png
from pipelines._tracking import input_digests, tracked_run
from pipelines._tracking.dvc_files import value_digest
from pipelines._tracking.families import experiment_of
from pipelines._tracking.store import profile_name, store_errors

PARAMS: dict[str, Any] = {"strokes": 3, "rate": 1e-3, "press": {"depth_m": 0.002}}


@pytest.fixture(scope="session")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("store")


@pytest.fixture
def client(store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A store that is made once, seen from a folder that is empty in each test."""
    from mlflow import MlflowClient

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{store / 'mlflow.db'}")
    monkeypatch.setenv("MLFLOW_LOGGING_LEVEL", "WARNING")
    yield MlflowClient()


def unfinished() -> list[Path]:
    return list(Path(".pentimento/runs").iterdir())


def test_names_that_the_store_refuses_are_made_safe(client: Any) -> None:
    names = [
        "Anna (left)",
        "Anna [left]",
        "O'Neil",
        "colour mode I;16",
        "a&b+c,d",
        "100 %",
        "é",
        "a//b",
        "/c",
        "../d",
        "e/",
    ]
    with tracked_run("paint", None, {"of": {"O'Neil": "x", "a/../b": 1}}, {}) as run:
        run.log_metrics({"hands": {name: number for number, name in enumerate(names)}})
        for name in names:
            run.log(name, 1.0)
            run.log_under(name)("loss", 2.0, 3)
            run.tag(name, "tagged")
        run.log_items("hand's", ["a"], [0.5])
        run.log_child("part", {"O'Neil": {0: 1.0}}, {})
    kept = client.get_run(run.id).data
    assert kept.metrics["hands.Anna _left_"] == 0 and kept.metrics["hands.Anna _left__"] == 1
    assert kept.metrics["hands.colour mode I_16"] == 3 and kept.metrics["hands.é"] == 6
    assert kept.metrics["items.hand_s"] == 0.5 and "items.hand_s" in kept.tags
    assert sum(name.startswith("hands.") for name in kept.metrics) == len(names)
    assert kept.params["of.O_Neil"] == "x"


def test_a_run_keeps_parameters_curves_pictures_inputs_tags_and_time(client: Any, store: Path) -> None:
    Path("strokes").mkdir()
    Path("strokes/part").write_text("x")
    Path("strokes/README.md").write_text("---\nlicense: cc-by-4.0\n---\n# Strokes\n\nOf the atelier.\n")
    write_png(Path("error.png"), np.full((4, 6, 3), 200, np.uint8))
    with tracked_run("paint", "colour", PARAMS, {"strokes": Path("strokes")}) as run:
        for step in range(250):
            run.log("loss", 1 / (1 + step), step)
        run.log_metrics({"gap": {"ours": 0.1, "text": "no number"}, "strokes": 300})
        run.log_picture(Path("error.png"))
        run.log_picture(Path("error.png"), "brush (round)", step=3)
    kept = client.get_run(run.id)
    assert kept.info.run_name == "paint · colour"
    assert kept.info.status == "FINISHED"
    assert kept.data.params == {"strokes": "3", "rate": "0.001", "press.depth_m": "0.002"}
    assert kept.data.metrics["gap.ours"] == 0.1
    assert kept.data.metrics["strokes"] == 300
    assert kept.data.metrics["wall_s"] > 0
    assert [point.step for point in client.get_metric_history(run.id, "loss")] == list(range(250))
    assert {"stage": "paint", "item": "colour", "profile": "default"}.items() <= kept.data.tags.items()
    (used,) = kept.inputs.dataset_inputs
    assert (used.dataset.name, used.dataset.digest) == ("strokes", input_digests({"it": Path("strokes")})["it"])
    assert {"source:strokes": "Of the atelier.", "licence:strokes": "cc-by-4.0"}.items() <= kept.data.tags.items()
    kept_files = {entry.path for entry in client.list_artifacts(run.id, "pictures")}
    assert kept_files == {"pictures/error.png", "pictures/brush (round)"}
    grid = {Path(entry.path).name.split("+timestamp")[0] for entry in client.list_artifacts(run.id, "images")}
    assert grid == {"paint~colour~error+step+0", "paint~colour~brush _round_~error+step+3"}  # MLflow writes `/` as `~`
    assert kept.data.metrics["system/cpu_s"] > 0
    assert 20 < kept.data.metrics["system/peak_memory_mb"] < 100_000  # Python alone takes more, no machine has that
    assert (store / "mlartifacts").is_dir()
    assert json.loads(Path("data/timings/paint@colour.json").read_text())["run_id"] == run.id
    assert "paint@colour" in Path("data/timings/index.html").read_text()
    assert not unfinished()


def test_an_interval_and_items_have_the_same_names_everywhere(client: Any) -> None:
    with tracked_run("paint", "marker", PARAMS, {}) as run:
        run.log_metrics({"held_out": {"mse": 0.1, "mse_ci": [0.05, 0.2], "words": ["a", "b"]}})
        run.log_items("held_out.mse", [7, 9], [0.05, 0.15])
    kept = client.get_run(run.id).data
    assert (kept.metrics["held_out.mse.low"], kept.metrics["held_out.mse.high"]) == (0.05, 0.2)
    assert [point.value for point in client.get_metric_history(run.id, "items.held_out.mse")] == [0.05, 0.15]
    assert kept.tags["items.held_out.mse"] == value_digest(["7", "9"])


def test_an_experiment_of_dvc_is_an_execution_of_its_name(client: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DVC_EXP_NAME", "sticky-tape")
    ids = set()
    for item in ("marker", "colour"):
        with pytest.raises(PentimentoError), tracked_run("paint", item, PARAMS, {}) as run:
            raise PentimentoError("No paint.")
        ids.add(client.get_run(run.id).data.tags["mlflow.parentRunId"])
    parent = client.get_run(ids.pop())
    assert not ids and (parent.info.run_name, parent.info.status) == ("sticky-tape", "FAILED")
    assert parent.data.tags["dvc_experiment"] == "sticky-tape"


def test_a_queued_experiment_is_kept_in_the_repository_and_not_in_its_copy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """DVC removes the copy that it runs in."""
    copy = tmp_path / ".dvc/tmp/exps/tmpx1y2"
    copy.mkdir(parents=True)
    monkeypatch.chdir(copy)
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "to be restored afterwards")
    del os.environ["MLFLOW_TRACKING_URI"]
    with store_errors():
        assert os.environ["MLFLOW_TRACKING_URI"] == f"sqlite:///{tmp_path / 'mlflow.db'}"


def test_a_bare_repro_in_a_profiles_copy_is_in_the_repositorys_store_under_the_profiles_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "to be restored afterwards")
    monkeypatch.delenv("PENTIMENTO_PROFILE", raising=False)
    for copy, profile in ((".profiles/smoke", "smoke"), (".profiles/smoke.seed2", "smoke"), ("clone", "default")):
        (tmp_path / copy).mkdir(parents=True)
        monkeypatch.chdir(tmp_path / copy)
        del os.environ["MLFLOW_TRACKING_URI"]
        root = tmp_path / "clone" if copy == "clone" else tmp_path
        with store_errors():
            assert os.environ["MLFLOW_TRACKING_URI"] == f"sqlite:///{root / 'mlflow.db'}"
        assert profile_name() == profile
    monkeypatch.setenv("PENTIMENTO_PROFILE", "full")
    assert profile_name() == "full"


def test_a_failed_run_says_why_and_is_not_continued(client: Any) -> None:
    with pytest.raises(PentimentoError), tracked_run("paint", None, PARAMS, {}) as failed:
        raise PentimentoError("The brush is missing.")
    kept = client.get_run(failed.id)
    assert (kept.info.status, kept.data.tags["error"]) == ("FAILED", "The brush is missing.")
    assert not Path("data/timings").exists()
    with tracked_run("paint", None, PARAMS, {}) as again:
        pass
    assert again.id != failed.id


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, SystemExit])
def test_an_interrupted_run_is_continued(client: Any, interruption: type[BaseException]) -> None:
    with pytest.raises(interruption), tracked_run("paint", "marker", PARAMS, {}) as first:
        first.log("loss", 1.0, 0)
        raise interruption
    assert client.get_run(first.id).info.status == "KILLED"
    with tracked_run("paint", "marker", PARAMS, {}) as second:
        assert client.get_run(second.id).info.status == "RUNNING"
        second.log("loss", 0.5, 1)
    assert second.id == first.id
    assert client.get_run(first.id).info.status == "FINISHED"
    assert [point.value for point in client.get_metric_history(first.id, "loss")] == [1.0, 0.5]


def test_an_interrupted_run_is_not_continued_with_other_parameters(client: Any) -> None:
    with pytest.raises(KeyboardInterrupt), tracked_run("paint", "marker", PARAMS, {}) as first:
        raise KeyboardInterrupt
    client.update_run(first.id, status="RUNNING")  # as SIGKILL would leave it
    with tracked_run("paint", "marker", PARAMS | {"strokes": 4}, {}) as second:
        pass
    assert second.id != first.id
    assert client.get_run(first.id).info.status == "KILLED"


def test_experiments_open_on_training_runs_and_keep_what_a_person_wrote(client: Any) -> None:
    """Also those of an earlier version, which had no tags."""
    written = experiment_of("paint_by_meaning"), experiment_of("sculpt")
    for name in written:
        if client.get_experiment_by_name(name) is None:
            client.create_experiment(name)
    painting, sculpting = (client.get_experiment_by_name(name).experiment_id for name in written)
    client.set_experiment_tag(sculpting, "mlflow.note.content", "Ours.")
    for stage in ("paint", "sculpt"):
        with tracked_run(stage, None, PARAMS, {}):
            pass
    tags = [client.get_experiment(each).tags for each in (painting, sculpting)]
    assert {each["mlflow.experimentKind"] for each in tags} == {"custom_model_development"}
    assert "`error.with_replanning` of `paint`" in tags[0]["mlflow.note.content"]
    assert tags[1]["mlflow.note.content"] == "Ours."


def test_a_run_that_is_gone_from_the_store_is_not_continued(client: Any) -> None:
    with pytest.raises(KeyboardInterrupt), tracked_run("paint", "marker", PARAMS, {}) as first:
        raise KeyboardInterrupt
    (state,) = unfinished()
    state.write_text(state.read_text().replace(first.id, "0" * 32))
    with tracked_run("paint", "marker", PARAMS, {}) as second:
        pass
    assert client.get_run(second.id).info.status == "FINISHED"


@pytest.mark.parametrize("text", ["", "[]", "{}"])
def test_a_damaged_note_of_a_run_is_not_continued(client: Any, text: str) -> None:
    with pytest.raises(KeyboardInterrupt), tracked_run("paint", "marker", PARAMS, {}):
        raise KeyboardInterrupt
    (state,) = unfinished()
    state.write_text(text)
    with tracked_run("paint", "marker", PARAMS, {}) as second:
        pass
    assert client.get_run(second.id).info.status == "FINISHED"


def test_a_store_that_does_not_open_is_one_sentence(client: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "file:///nowhere")
    sentence = "MLflow's store file:///nowhere fails"
    with pytest.raises(PentimentoError, match=sentence), tracked_run("paint", None, PARAMS, {}):
        pass


def test_a_store_of_another_version_of_mlflow_is_one_sentence(client: Any) -> None:
    from alembic.util import CommandError

    sentence = r"MLflow's store .* fails \(Can't locate revision"
    with pytest.raises(PentimentoError, match=sentence), tracked_run("paint", None, PARAMS, {}):
        raise CommandError("Can't locate revision identified by 'cafe'")


def test_an_input_has_the_digest_that_dvc_knows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("dvc.lock").write_text(
        "stages:\n  a@x:\n    outs:\n    - {path: data/a, md5: 0123.dir}\n  b:\n    cmd: echo\n"
    )
    Path("data/a").mkdir(parents=True)
    Path("data/a/part").write_text("x")
    Path("data/b").write_text("x")
    assert input_digests({"it": Path("data/a")})["it"] == "0123.dir"
    assert input_digests({"it": Path("data/b")})["it"] == input_digests({"it": Path("data/a/part")})["it"]
    with pytest.raises(FileNotFoundError):
        input_digests({"it": Path("data/absent")})["it"]


def test_lightning_writes_into_the_run(client: Any) -> None:
    with tracked_run("paint", "lightning", PARAMS, {}) as run:
        logger = run.mlflow_logger()
        logger.log_metrics({"val_loss": 0.25}, step=3)
        logger.finalize("success")
    assert logger.run_id == run.id
    assert client.get_run(run.id).data.metrics["val_loss"] == 0.25
    assert client.get_experiment_by_name(experiment_of("paint")) is not None


def test_stages_that_begin_at_once_share_store_experiment_and_execution(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each in its own process, as side by side they are; the store is not there yet."""
    from mlflow import MlflowClient

    (tmp_path / "params.yaml").write_text("{}")
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{tmp_path / 'mlflow.db'}")
    monkeypatch.setenv("PENTIMENTO_EXECUTION", "default · now")
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
    code = (
        "import sys; from pipelines._tracking import tracked_run\nwith tracked_run('paint', sys.argv[1], {}, {}): pass"
    )
    stages = [subprocess.Popen([sys.executable, "-c", code, item], cwd=tmp_path) for item in ("colour", "marker")]
    assert [stage.wait(120) for stage in stages] == [0, 0]
    client = MlflowClient(f"sqlite:///{tmp_path / 'mlflow.db'}")
    (experiment,) = [one for one in client.search_experiments() if one.name == experiment_of("paint")]
    runs = client.search_runs([experiment.experiment_id])
    (parent,) = [run for run in runs if run.data.tags["kind"] == "execution"]
    stages_of = [run for run in runs if run.data.tags.get("mlflow.parentRunId") == parent.info.run_id]
    assert {run.data.tags["item"] for run in stages_of} == {"colour", "marker"}
