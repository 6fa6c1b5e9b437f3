"""Tests of the stage collect_strokes."""

import argparse
import json
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML

import pipelines.collect_strokes as stage
from pentimento.contracts.errors import ConfigError, PentimentoError
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.planning.strokes.latent import Layer, StyleDecoder, write_decoder
from pipelines._imports import ROOT
from pipelines._params import read_params


@pytest.fixture
def folder(stage_folder: Path) -> Path:
    section = read_params(ROOT / "params.yaml")["collect_strokes"]
    section["collection"] |= {"strokes": 12, "repeated": 1, "times": 2, "pixels_per_m": 1000}
    YAML(typ="safe").dump({"collect_strokes": section}, stage_folder / "params.yaml")
    return stage_folder


def test_largest_aliasing_is_a_metric_of_the_strokes(folder: Path) -> None:
    from mlflow import MlflowClient

    stage.main(argparse.Namespace(tool="round_brush", out=folder / "strokes"))
    metrics = json.loads((folder / "strokes/metrics.json").read_text())
    assert metrics["rows"] == 12 == read_table(folder / "strokes", CONTRACT).table.num_rows
    assert 0 < metrics["largest_aliasing"] <= 1
    (run,) = MlflowClient().search_runs(
        [experiment.experiment_id for experiment in MlflowClient().search_experiments()]
    )
    assert run.data.metrics["largest_aliasing"] == pytest.approx(metrics["largest_aliasing"])


def test_prints_aliased_causes_before_any_stroke(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class RobotError(PentimentoError): ...

    def power_cut(*_: object) -> None:
        raise RobotError("no power")

    monkeypatch.setattr(stage, "collect_strokes", power_cut)
    with pytest.raises(RobotError, match="no power"):
        stage.main(argparse.Namespace(tool="round_brush", out=folder / "strokes"))
    assert "cannot distinguish: " in capsys.readouterr().err
    assert not (folder / "strokes").exists()


def test_strokes_of_a_hand_are_collected_at_its_points(folder: Path) -> None:
    rng = np.random.default_rng(0)
    layer = Layer(
        np.zeros((2, 40), np.float32), (rng.normal(0, 0.2, 40) + np.repeat(np.arange(20), 2)).astype(np.float32)
    )
    latents = np.zeros((3, 2), np.float32)
    write_decoder(folder / "ann.npz", StyleDecoder("ann", (layer,), 5e-4, latents, latents))
    params = read_params(folder / "params.yaml")
    params["collect_strokes"]["hand"] = {"round_brush": str(folder / "ann.npz")}
    YAML(typ="safe").dump(params, folder / "params.yaml")
    stage.main(argparse.Namespace(tool="round_brush", out=folder / "strokes"))
    paths = [np.array(path) for path in read_table(folder / "strokes", CONTRACT).table.column("path").to_pylist()]
    assert {path.shape for path in paths} == {(20, 5)}
    lengths = [np.linalg.norm(np.diff(path[:, 1:3], axis=0), axis=1).sum() for path in paths]
    assert np.ptp(lengths) < 1e-6
    assert "handwriting style “ann”" in (folder / "strokes/README.md").read_text()


def test_a_measured_table_and_a_hand_are_one_too_many(folder: Path) -> None:
    params = read_params(folder / "params.yaml")
    params["collect_strokes"] |= {"hand": {"marker": "ann.npz"}, "source": {"marker": "strokes.parquet"}}
    YAML(typ="safe").dump(params, folder / "params.yaml")
    with pytest.raises(ConfigError, match="source and hand both name marker"):
        stage.main(argparse.Namespace(tool="marker", out=folder / "strokes"))
    assert not (folder / "strokes").exists()


def test_a_damaged_hand_is_one_sentence(folder: Path) -> None:
    (folder / "ann.npz").write_bytes(b"ann")
    params = read_params(folder / "params.yaml")
    params["collect_strokes"]["hand"] = {"marker": str(folder / "ann.npz")}
    YAML(typ="safe").dump(params, folder / "params.yaml")
    with pytest.raises(PentimentoError, match=r"ann\.npz holds no decoder"):
        stage.main(argparse.Namespace(tool="marker", out=folder / "strokes"))
    assert not (folder / "strokes").exists()


def test_an_npz_of_paths_and_pictures_becomes_the_table(folder: Path) -> None:
    t = np.linspace(0, 1, 5)
    path = np.stack([np.stack([10 + 20 * t, 15 + 5 * number + 0 * t, t], axis=-1) for number in range(3)])
    after = np.full((3, 60, 80, 3), 255, np.uint8)
    after[:, 20:40, 20:60] = 30
    np.savez(folder / "pairs.npz", path=path, before=np.full_like(after, 255), after=after)
    params = read_params(folder / "params.yaml")
    params["collect_strokes"]["source"] = {"brush": "pairs.npz"}
    YAML(typ="safe").dump(params, folder / "params.yaml")
    with pytest.raises(ConfigError, match=r"pairs has no entry for it: an \.npz needs one"):
        stage.main(argparse.Namespace(tool="brush", out=folder / "strokes"))
    assert not (folder / "strokes").exists()
    of_brush = {"unit_m": "1 mm", "press_m": "2 mm", "window_m": ["0 mm", "0 mm", "40 mm", "30 mm"]}
    params["collect_strokes"]["pairs"] = {"brush": of_brush}
    YAML(typ="safe").dump(params, folder / "params.yaml")
    stage.main(argparse.Namespace(tool="brush", out=folder / "strokes"))
    rows = read_table(folder / "strokes", CONTRACT).table.to_pylist()
    assert len(rows) == 3 and (folder / "strokes/contact_sheet.png").is_file()
    for row, made in zip(rows, path, strict=True):
        np.testing.assert_allclose(np.array(row["path"])[:, 1:4], 1e-3 * made * [1, 1, -2], atol=1e-7)
