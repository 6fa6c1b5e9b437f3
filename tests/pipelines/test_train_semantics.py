"""The stage train_semantics: two encoders in the published layout, scored on held-out compositions."""

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from pentimento.contracts.errors import ConfigError
from pentimento.contracts.scenes import CONTRACT
from pentimento.contracts.tables import write_table
from pentimento.copainting.scenes.procedural import ScenesConfig, build_scenes
from pentimento.semantics.encoder import Encoder
from pipelines._config import load_section, shipped
from pipelines.train_semantics import TrainSemantics, main
from pipelines.train_semantics import _train as train

ROOT = Path(__file__).parents[2]
SHAPE = {"image_px": 16, "patch_px": 8, "image_width": 32, "image_layers": 2, "text_width": 16, "text_layers": 1}
SHAPE |= {"heads": 2, "embedding": 16}
TRAINING = {"steps": 5, "batch": 8, "rate": 0.003, "warmup": 0.1, "weight_decay": 0.01}
TRAINING |= {"object_weight": 1.0, "patch_weight": 1.0, "precision": "32-true", "seed": 0}
TRAINING |= {"view_shares": {"picture": 0.4, "lines": 0.2, "hatching": 0.1, "grey": 0.1, "strokes": 0.1, "paint": 0.1}}


def section() -> dict:
    entry = {"published": None, "shape": SHAPE, "training": TRAINING}
    judge = entry | {"shape": SHAPE | {"image_layers": 0}, "training": TRAINING | {"seed": 1}}
    return {
        "merges": 300, "caption_tokens": 24, "views_seed": 0, "test_scenes": 24,
        "retrieval_candidates": 8,
        "encoders": {"main": entry, "judge": judge},
    }  # fmt: skip


def write_inputs(folder: Path, params: dict) -> None:
    if not (folder / "scenes").exists():
        table = build_scenes(ScenesConfig(70, 32, 0.1, 0.4, 4, 0), lambda *_: None)
        write_table(folder / "scenes", table, CONTRACT, "# Card")
    YAML(typ="safe").dump({"train_semantics": params}, folder / "params.yaml")


def run(folder: Path, params: dict) -> dict[str, Path]:
    write_inputs(folder, params)
    outs = {"semantics": folder / "semantics", "judge": folder / "judge"}
    inputs = {"params": Path("params.yaml"), "scenes": folder / "scenes", "judge_scenes": None, "base": None}
    main(argparse.Namespace(**inputs, **outs))
    return outs


def test_two_encoders_with_scores_beside_chance_and_the_same_bytes_again(stage_folder: Path) -> None:
    outs = run(stage_folder, section())
    encoders = {name: Encoder.load(folder) for name, folder in outs.items()}
    assert encoders["semantics"].digest != encoders["judge"].digest
    for name, folder in outs.items():
        metrics = json.loads((folder / "metrics.json").read_text())
        assert metrics["digest"] == encoders[name].digest
        for view in ("picture", "lines", "hatching", "grey", "strokes", "paint"):
            assert metrics[view]["retrieval"]["chance"] == 1 / 8
            assert 0 <= metrics[view]["objects"]["recognised"] <= 1
            assert 0 < metrics[view]["objects"]["chance"] < 0.2
    # Again: the judge is trained again, the main encoder is read from the output of the first run.
    params = section()
    params["encoders"]["main"]["published"] = "base"
    write_inputs(stage_folder, params)
    config = load_section(Path("params.yaml"), "train_semantics", TrainSemantics)
    for name in config.encoders:
        (stage_folder / "again" / name).mkdir(parents=True)
        published = shipped(config.encoders[name].published, stage_folder, "semantics")
        train(name, config, stage_folder / "scenes", published, stage_folder / "again" / name)
    for file in outs["judge"].iterdir():
        assert (stage_folder / "again/judge" / file.name).read_bytes() == file.read_bytes(), file.name
    assert Encoder.load(stage_folder / "again/main").digest == encoders["semantics"].digest


def test_a_base_that_the_stage_was_not_given_is_a_sentence(stage_folder: Path) -> None:
    params = section()
    params["encoders"]["main"]["published"] = "base"
    with pytest.raises(ConfigError, match="semantics of the base that ships, but the stage has no --base"):
        run(stage_folder, params)


def test_a_judge_that_is_the_same_is_a_sentence(stage_folder: Path) -> None:
    params = section()
    params["encoders"]["judge"] = params["encoders"]["main"]
    with pytest.raises(ConfigError, match="give the judge another seed"):
        run(stage_folder, params)


@pytest.mark.skipif(sys.platform != "linux", reason="who ends with whom is Linux's to say")
def test_a_killed_stage_leaves_nobody_training(tmp_path: Path) -> None:
    params = section()
    for encoder in params["encoders"].values():
        encoder["training"] = encoder["training"] | {"steps": 10**6}
    write_inputs(tmp_path, params)
    places = {"PYTHONPATH": str(ROOT), "MLFLOW_TRACKING_URI": f"sqlite:///{tmp_path / 'mlflow.db'}"}
    arguments = ["--scenes", "scenes", "--semantics", "semantics", "--judge", "judge"]
    stage = subprocess.Popen(
        [sys.executable, "-m", "pipelines.train_semantics", *arguments], cwd=tmp_path, env=os.environ | places
    )
    workers = within_s(90, lambda: workers_of(stage.pid), 2)
    stage.kill()
    stage.wait()
    assert within_s(30, lambda: [pid for pid in workers if at_work(pid)], 0) == []


def workers_of(pid: int) -> list[int]:
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [int(child) for child in children if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]


def at_work(pid: int) -> bool:
    status = Path(f"/proc/{pid}/stat")
    return status.exists() and status.read_text().rsplit(")", 1)[1].split()[0] != "Z"


def within_s(most_s: float, look: Callable[[], list[int]], count: int) -> list[int]:
    """What is seen once there are so many, or in the end."""
    deadline_s = time.monotonic() + most_s
    while len(seen := look()) != count and time.monotonic() < deadline_s:
        time.sleep(0.1)
    return seen
