"""The stage synthesize_copaintings: the same bytes by any number of workers, killed or not; what it says is so."""

import argparse
import importlib.util
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from pentimento.contracts import copaintings, scenes
from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.images import read_image
from pentimento.contracts.tables import read_table, write_table
from pentimento.copainting.synthesis import shards
from pipelines._imports import ROOT
from pipelines.synthesize_copaintings import main
from tests.copainting.painters import section, write_encoder, write_stroke_model

SCRATCH = Path(".pentimento/synthesis")


@pytest.fixture
def folder(stage_folder: Path) -> Path:
    """Example scenes and models, and params.yaml."""
    write_table(Path("scenes"), scenes.example_table(10), scenes.CONTRACT, "# Card")
    write_stroke_model(Path("models/stroke_marker/weights"))
    write_encoder(Path("semantics"))
    write_params()
    return stage_folder


def write_params(**changes: Any) -> None:
    YAML(typ="safe").dump({"synthesize_copaintings": section(**changes)}, Path("params.yaml"))


def run(out: str) -> Path:
    folders = {"scenes": Path("scenes"), "models": Path("models"), "semantics": Path("semantics"), "out": Path(out)}
    main(argparse.Namespace(setting="marker", tools=["marker"], **folders))
    return Path(out)


def contents(folder: Path) -> dict[str, bytes]:
    return {str(file.relative_to(folder)): file.read_bytes() for file in sorted(folder.rglob("*")) if file.is_file()}


@contextmanager
def begun(workers: int) -> Iterator[subprocess.Popen[bytes]]:
    """The stage in a process of its own, which is killed when the block ends."""
    write_params(workers=workers)
    command = [sys.executable, "-m", "pipelines.synthesize_copaintings", "--setting", "marker", "--tools", "marker"]
    command += ["--scenes", "scenes", "--models", "models", "--semantics", "semantics", "--out", "killed"]
    environment = os.environ | {"PYTHONPATH": f"{ROOT}:{ROOT / 'src'}", "HF_HUB_DISABLE_PROGRESS_BARS": "1"}
    with subprocess.Popen(command, env=environment) as process:
        try:
            yield process
        finally:
            process.kill()


def test_pairs_are_kept_by_score_and_the_numbers_are_those_of_the_table(folder: Path) -> None:
    out = run("out")
    table = read_table(out, copaintings.CONTRACT).table
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["scenes"] == metrics["paintings"] == 5 and metrics["pairs"] == table.num_rows
    assert min(table["clip_score"].to_pylist()) >= metrics["threshold"] - 1e-6
    assert 0 < metrics["kept_share"]["pairs"] <= 1
    counted = table["strategy"].to_pylist()
    assert {name: entry["pairs"] for name, entry in metrics["strategies"].items()} == {
        name: counted.count(name) for name in copaintings.STRATEGIES if name in counted
    }
    assert metrics["strategies"]["all"]["strokes_kept"] == 0 and metrics["strategies"]["all"]["mse_of_copying"] > 0
    splits = dict(zip(table["scene_id"].to_pylist(), table["split"].to_pylist(), strict=True))
    of_scenes = read_table(Path("scenes"), scenes.CONTRACT).table
    told = dict(zip(of_scenes["scene_id"].to_pylist(), of_scenes["split"].to_pylist(), strict=True))
    assert all(told[name] == split for name, split in splits.items())
    card = (out / "README.md").read_text()
    assert "CC0-1.0" in card and f"{metrics['pairs']} pairs" in card and "`clip_score`" in card
    assert read_image(out / "preview.png").shape == (5 * 100, 9 * 100, 3)
    assert not list(SCRATCH.rglob("*.parquet"))  # scratch is gone when the work is done


def test_half_scenes_are_painted_and_asked_for_beside_each_other(folder: Path) -> None:
    table = read_table(Path("scenes"), scenes.CONTRACT).table
    plain = table.drop_columns(["objects"])  # no example shows two kinds together, so none might meet
    write_table(Path("scenes"), plain, scenes.CONTRACT, "# Card")
    write_params(half_scenes={"train": 8, "val": 0, "test": 0}, pairs_per_half_scene=1)
    out = run("out")
    rows = read_table(out, copaintings.CONTRACT).table.to_pylist()
    halves = [row for row in rows if "/" in row["scene_id"]]
    assert {row["strategy"] for row in halves} == {"all", "beside"} and {row["split"] for row in halves} == {"train"}
    there = {row["plan_id"] for row in halves if row["strategy"] == "all"}
    asked = [row for row in halves if row["strategy"] == "beside"]
    assert asked and all(set(row["plan_id"].split(" + ")) <= there for row in asked)
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["scenes"] == metrics["paintings"] == 13 and metrics["strategies"]["beside"]["pairs"] == len(asked)


def test_a_threshold_between_the_scores_leaves_out_what_is_below(folder: Path) -> None:
    every = read_table(run("every"), copaintings.CONTRACT).table
    scores = sorted(every["clip_score"].to_pylist())
    middle = scores[len(scores) // 2]
    write_params(threshold={"score": middle, "mismatched_quantile": None, "seed": 0})
    some = read_table(run("some"), copaintings.CONTRACT).table
    assert sorted(some["clip_score"].to_pylist()) == [score for score in scores if score >= middle]
    write_params(threshold={"score": 1.0, "mismatched_quantile": None, "seed": 0})
    with pytest.raises(ContractError, match=r"No painting scores 1 or more.*lower synthesize_copaintings\.threshold"):
        run("none")
    assert not Path("none").exists()


def test_stopped_and_started_again_paints_only_the_rest_and_gives_the_same_bytes(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = contents(run("whole"))
    paint, painted = shards.paint_shard, []

    def die_at_the_third(job: shards.Job) -> bytes:
        if len(painted) == 2:
            raise SystemExit(143)  # as SIGTERM ends a stage
        painted.append(job)
        return paint(job)

    monkeypatch.setattr(shards, "paint_shard", die_at_the_third)
    with pytest.raises(SystemExit):
        run("again")
    assert not Path("again").exists() and len(list(SCRATCH.rglob("part-*.parquet"))) == 2
    left: list[shards.Job] = []
    monkeypatch.setattr(shards, "paint_shard", lambda job: (left.append(job), paint(job))[1])
    assert contents(run("again")) == whole
    assert len(left) == 1


@pytest.mark.timeout(400)  # three processes load PyTorch
def test_killed_with_two_workers_and_finished_by_one_gives_the_bytes_of_one(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """SIGKILL as soon as a shard is there: nothing can be tidied up."""
    whole = contents(run("whole"))
    with begun(workers=2) as process:
        while not list(SCRATCH.rglob("part-*.parquet")):
            assert process.poll() is None, "the stage ended before it could be killed"
            time.sleep(0.02)
        process.send_signal(signal.SIGKILL)
    assert not Path("killed").exists()
    there = len(list(SCRATCH.rglob("part-*.parquet")))
    write_params(workers=1)
    paint, left = shards.paint_shard, list[shards.Job]()
    monkeypatch.setattr(shards, "paint_shard", lambda job: (left.append(job), paint(job))[1])
    assert contents(run("killed")) == whole
    assert there >= 1 and len(left) == 3 - there  # none is painted twice


@pytest.mark.skipif(importlib.util.find_spec("distributed") is None, reason="dask is not installed")
@pytest.mark.timeout(400)
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_dask_cluster_makes_the_same_bytes(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = importlib.import_module("distributed")
    whole = contents(run("whole"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), str(ROOT / "src"), os.environ.get("PYTHONPATH", "")]))
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:
        write_params(scheduler=cluster.scheduler_address)
        assert contents(run("cluster")) == whole


def test_what_does_not_fit_is_a_sentence(folder: Path) -> None:
    with pytest.raises(ConfigError, match="hands the stage models of round_brush only"):
        main(argparse.Namespace(setting="marker", tools=["round_brush"], models=Path("models")))
    table = read_table(Path("scenes"), scenes.CONTRACT).table
    write_table(Path("plain"), table.drop_columns(["split"]), scenes.CONTRACT, "# Card")
    folders = {"models": Path("models"), "semantics": Path("semantics"), "out": Path("out")}
    with pytest.raises(ContractError, match="lack split"):
        main(argparse.Namespace(setting="marker", tools=["marker"], scenes=Path("plain"), **folders))
    write_params(scenes={"train": 0, "val": 0, "test": 0})
    with pytest.raises(ContractError, match="asks for no scene at all"):
        run("out")
    assert not Path("out").exists()
