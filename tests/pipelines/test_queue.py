"""The recipe of docs/scale.md: experiments that DVC queues are runs in the one store, in executions of their names."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pipelines._imports import ROOT
from pipelines._review.history import History
from pipelines._tracking.store import store_errors

FILES = {
    "dvc.yaml": "stages: {train: {cmd: python train.py, params: [train], metrics: [metrics.json: {cache: false}]}}\n",
    "params.yaml": "train: {epochs: 1}\n",
    ".gitignore": "/mlflow.db*\n/mlartifacts/\n/data/\n/.pentimento/\n",
    "train.py": """\
from pathlib import Path

from pipelines._params import read_yaml
from pipelines._io import write_json
from pipelines._tracking import tracked_run

params = read_yaml(Path("params.yaml"))["train"]
with tracked_run("train", None, params, {}) as run:
    metrics = {"error": 1 / params["epochs"]}
    write_json(Path("metrics.json"), metrics)
    run.log_metrics(metrics)
""",
}
ENDED_S = 80  # after which it is given up


def run(*command: str) -> str:
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def names_of_both() -> set[str]:
    """DVC's names of the two experiments, as soon as both are there: it keeps each in a reference of git's."""
    given_up = time.monotonic() + ENDED_S
    while len(kept := run("git", "for-each-ref", "--format=%(refname)", "refs/exps/??/*/*").split()) < 2:
        assert time.monotonic() < given_up, run("dvc", "queue", "status")
        time.sleep(0.2)
    return {Path(reference).name for reference in kept}


def test_queued_experiments_are_runs_under_their_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}{os.pathsep}{ROOT / 'src'}")
    for name, text in FILES.items():
        Path(name).write_text(text)
    run("git", "init", "-q")
    run("dvc", "init", "-q")
    run("git", "add", ".")
    run("git", "-c", "user.name=a", "-c", "user.email=a@example.org", "commit", "-qm", "Pipeline")

    run("dvc", "exp", "run", "-q", "--queue", "-S", "train.epochs=2,4")
    run("dvc", "queue", "start")
    try:
        names = names_of_both()
    finally:
        run("dvc", "queue", "stop")

    monkeypatch.setenv(
        "MLFLOW_TRACKING_URI", f"sqlite:///{tmp_path / 'mlflow.db'}"
    )  # not in the copies, which are gone
    with store_errors():
        history = History()
    found = {each.params["epochs"]: each for each in history.runs}
    assert set(found) == {"2", "4"} and found["4"].metrics["error"] == 0.25
    for kept in (history.executions, history.runs):
        assert {each.tags["execution"] for each in kept} == {each.tags["dvc_experiment"] for each in kept} == names
    assert {each.status for each in history.executions} == {"FINISHED"}
    assert Path("params.yaml").read_text() == FILES["params.yaml"] and not Path("metrics.json").exists()
    assert run("git", "status", "--porcelain") == ""
