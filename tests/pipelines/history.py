"""Runs for tests of reviewing: two executions of a small pipeline whose true difference is known."""

import json
from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.images import write_png
from pipelines._review.agreement import link
from pipelines._tracking import tracked_run
from pipelines._tracking.store import VARIABLE

ITEMS = 20


def repository(folder: Path) -> None:
    """The pipeline's files and its data, in the current folder `folder`."""
    (folder / "data/strokes").mkdir(parents=True)
    (folder / "data/strokes/part").write_text("strokes")
    (folder / "data/strokes/README.md").write_text("# Strokes\n\nMade by the robot in the studio. 108 rows.\n")
    (folder / "dvc.yaml").write_text(
        "stages:\n  train_stroke_dynamics: {cmd: x, matrix: {tool: [marker]}}\n  paint: {cmd: x}\n"
    )


def execute(name: str, epochs: int, error: float, monkeypatch: pytest.MonkeyPatch, stages: tuple[str, ...]) -> None:
    """One execution: training reaches `error` on held-out actions, give or take the same noise each time."""
    monkeypatch.setenv(VARIABLE, name)
    Path("params.yaml").write_text(json.dumps({"train_stroke_dynamics": {"epochs": epochs}, "paint": {"strokes": 3}}))
    if "train_stroke_dynamics" in stages:
        _train(epochs, error)
    if "paint" in stages:
        with tracked_run("paint", None, {"strokes": 3}, {}) as run:
            run.log_metrics({"error": {"with_replanning": 0.5, "without_replanning": 0.6}})
    _lock(epochs, error)
    link(Path.cwd(), name, "FINISHED")


def _train(epochs: int, error: float) -> None:
    with tracked_run("train_stroke_dynamics", "marker", {"epochs": epochs}, {"strokes": Path("data/strokes")}) as run:
        for epoch in range(epochs):
            run.log("loss", 1 / (1 + epoch), epoch)
        noise = np.random.default_rng(0).normal(0, 0.01, ITEMS)
        jitter = np.random.default_rng([1, epochs]).normal(0, 0.001, ITEMS)  # of this training
        values = (error + noise + jitter).tolist()
        figures = {"model": {"mse": float(np.mean(values)), "iou": 1 - error}, "polyline": {"mse": 0.4, "iou": 0.5}}
        run.log_metrics({"held_out": figures})
        run.log_items("held_out.model.mse", [f"action {n}" for n in range(ITEMS)], values)
        canvas = np.full((40, 60, 3), 255, np.uint8)
        canvas[10:20, 5 : 5 + int(100 * error)] = (40, 60, 160)
        write_png(Path("strokes.png"), canvas)
        run.log_picture(Path("strokes.png"))


def digest_of(error: float) -> str:
    """A stand-in for the MD5 of the model that has this error."""
    return f"{int(1e6 * error)}".ljust(32, "0")


def _lock(epochs: int, error: float) -> None:
    """As DVC would write it."""
    from pipelines._tracking import input_digests

    Path("dvc.lock").unlink(missing_ok=True)
    strokes = input_digests({"it": Path("data/strokes")})["it"]
    Path("dvc.lock").write_text(
        f"""stages:
  train_stroke_dynamics@marker:
    deps: [{{path: data/strokes, md5: {strokes}}}, {{path: pipelines/x.py, md5: abc}}]
    params: {{params.yaml: {{train_stroke_dynamics: {{epochs: {epochs}}}}}}}
    outs: [{{path: models/stroke_marker_base/weights, md5: "{digest_of(error)}"}}]
  paint:
    params: {{params.yaml: {{paint: {{strokes: 3}}}}}}
    outs: [{{path: data/paintings, md5: cafe}}]
  gone:
    outs: [{{path: data/gone, md5: cafe}}]
"""
    )
