"""The stage run_bundle: the lean runner paints and sculpts, and what it says is what the workshop keeps."""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML

from pentimento.contracts.errors import PentimentoError
from pentimento.contracts.images import encode_png, read_image
from pentimento.report.html import Album
from pentimento.report.performances import performances_section, read_performances
from pipelines import run_bundle as stage
from pipelines._tracking.families import experiment_of
from tests.control.painting_bundle import write_painting_bundle
from tests.control.sculpting_bundle import add_clay

ROOT = Path(__file__).parents[2]
PAINTINGS = {
    "photograph": {"setting": "pen", "words": None, "strokes": 4},
    "words": {"setting": "pen", "words": "a hut", "strokes": 3},
}
SCULPTURES = {"dash": {"material": "foam", "letter": "-", "pushes": 2}}


@pytest.fixture
def folder(stage_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A bundle, and a painting of the workshop's."""
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}:{ROOT / 'src'}")  # of the runner's process, which starts in the folder
    add_clay(write_painting_bundle(stage_folder / "bundle"))
    workshop = stage_folder / "paintings/pen"
    workshop.mkdir(parents=True)
    photograph = np.full((40, 60, 3), 235, np.uint8)
    photograph[12:28, 15:45] = 40
    (workshop / "photograph.png").write_bytes(encode_png(photograph))
    (workshop / "metrics.json").write_text(json.dumps({"strokes": 5, "error": {"with_replanning": 0.01}}))
    return stage_folder


def run(paintings: dict[str, Any], sculptures: dict[str, Any], out: str = "out") -> Path:
    section = {"seed": 3, "paintings": paintings, "sculptures": sculptures}
    YAML(typ="safe").dump({"run_bundle": section}, Path("params.yaml"))
    stage.main(argparse.Namespace(bundle=Path("bundle"), paintings=Path("paintings"), out=Path(out)))
    return Path(out)


def test_a_sculpture_is_carved_and_told(folder: Path) -> None:
    from mlflow import MlflowClient

    out = run({}, SCULPTURES)
    told = json.loads((out / stage.SCULPTURES).read_text())["dash"]
    assert told.items() >= SCULPTURES["dash"].items()
    assert told["actions"] == 2
    assert told["error_3d_mm2"]["after"] < told["error_3d_mm2"]["before"]
    before, goal, result = (read_image(out / f"dash/{name}.png").astype(int) for name in stage.HEIGHTS)
    assert before.shape == goal.shape == result.shape
    of_goal, of_result = ((np.abs(picture - before) > 8).mean() for picture in (goal, result))
    assert 0.005 < of_result < of_goal  # the shadows of two dents, where a whole dash is wanted
    assert not (out / "dash/pushes").exists()  # the pictures are kept, not the record
    assert "2 actions" in performances_section(read_performances(out), Album())

    client = MlflowClient()
    experiment = client.get_experiment_by_name(experiment_of("run_bundle"))
    assert experiment is not None
    (tracked,) = client.search_runs([experiment.experiment_id])
    assert tracked.data.metrics["dash.error_3d_mm2.after"] == pytest.approx(told["error_3d_mm2"]["after"])
    assert [entry.path for entry in client.list_artifacts(tracked.info.run_id, "pictures/dash")] == [
        "pictures/dash/result.png"
    ]


def test_paintings_stand_beside_the_workshop_s(folder: Path) -> None:
    told = json.loads((run(PAINTINGS, {}) / "metrics.json").read_text())
    assert told["photograph"]["workshop"] == {"strokes": 5, "error": 0.01}
    assert 1 <= told["photograph"]["strokes"] <= 4 and 1 <= told["words"]["strokes"] <= 3
    assert "workshop" not in told["words"]
    for name in PAINTINGS:
        shapes = {read_image(Path("out") / name / picture).shape for picture in stage.PICTURES}
        assert len(shapes) == 1
        assert told[name]["error"]["canvas"] > 0


def test_what_the_runner_refuses_fails_the_stage_and_leaves_nothing(folder: Path) -> None:
    with pytest.raises(PentimentoError, match=r"(?s)failed in material sand: .*no push model of 'sand'"):
        run({}, {"dune": {"material": "sand", "letter": "-", "pushes": 2}})
    assert not Path("out").exists()
