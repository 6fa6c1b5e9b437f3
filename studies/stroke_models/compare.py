"""Train all models on one table and score them on others, stroke by stroke; each model's result is kept in its file."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import torch
from torch import Tensor

from pentimento.dynamics.strokes.evaluation import score
from pentimento.dynamics.strokes.extended import MeasuredStrokes
from pentimento.dynamics.strokes.samples import StrokeSamples
from pentimento.dynamics.strokes.training import TrainingConfig
from studies.stroke_models.candidates import NAMES, Predict, Training, load_strokes

SHOWN = 8
"""Strokes of each test set whose pictures are kept."""
_RENDERED = 10

Results = dict[str, dict[str, Any]]
"""By model: ``scores`` by test set (``l1`` and ``iou`` of each stroke), ``train_s``, ``render_ms``, ``said``."""


def compare(
    training: pa.Table,
    tests: Mapping[str, pa.Table],
    config: TrainingConfig,
    out: Path,
    names: Sequence[str] = tuple(NAMES),
) -> Results:
    """Fill in what is missing of ``out``, ``<model>.json`` and ``<model>.npz`` (pictures), and read it all.

    ``config``: of Traj2Stroke; every model sees its resolution, and is trained with its seed.
    """
    out.mkdir(parents=True, exist_ok=True)
    missing = [name for name in names if not (out / f"{name}.json").exists()]
    if missing:
        strokes = {name: load_strokes(table, config) for name, table in tests.items()}
        learnt = Training(training, torch.cat([each.samples.path for each in strokes.values()]), config)
        _keep_measured(strokes, out)
        for name in missing:
            print(f"{out}: {name} …", flush=True)
            _one(name, learnt, strokes, out)
    return read_results(out)


def read_results(out: Path) -> Results:
    """What there is of a comparison, by model."""
    files = {name: out / f"{name}.json" for name in NAMES}
    return {name: json.loads(file.read_text()) for name, file in files.items() if file.exists()}


def _one(name: str, learnt: Training, tests: Mapping[str, MeasuredStrokes], out: Path) -> None:
    trained, seconds = learnt.fit(name)
    result: dict[str, Any] = {"train_s": seconds, "render_ms": _render_ms(trained.predict, learnt.strokes)}
    result |= {"strokes": len(learnt.samples.path), "said": dict(trained.said), "scores": {}}
    pictures = {}
    for test, strokes in tests.items():
        predicted = trained.predict(strokes)
        other = predicted if trained.predict_for_iou is trained.predict else trained.predict_for_iou(strokes)
        result["scores"][test] = {
            "l1": [one.l1 for one in scores_of(predicted, strokes.samples)],
            "iou": [one.iou for one in scores_of(other, strokes.samples)],
        }
        pictures[test] = _bytes(predicted[:SHOWN])
    np.savez_compressed(out / f"{name}.npz", **pictures)
    (out / f"{name}.json").write_text(json.dumps(result))


def scores_of(predicted: Tensor, samples: StrokeSamples) -> list[Any]:
    """Scores of each stroke by itself; the IoU of a stroke that left no ink is NaN."""
    rows = torch.arange(len(predicted))
    return [score(predicted[row : row + 1], samples.pick(rows[row : row + 1])) for row in rows]


def _render_ms(predict: Predict, strokes: MeasuredStrokes) -> float:
    """CPU time for one stroke, the least of a few."""
    times = []
    for row in range(min(_RENDERED, len(strokes.samples.path))):
        one = strokes.pick(torch.tensor([row]))
        started = time.process_time()
        predict(one)
        times.append(time.process_time() - started)
    return 1e3 * min(times)


def _keep_measured(tests: Mapping[str, MeasuredStrokes], out: Path) -> None:
    """``measured.npz``: for each test set the photographs of the strokes that are shown, and their paths in pixels."""
    kept = {}
    for name, strokes in tests.items():
        samples = strokes.samples.pick(torch.arange(min(SHOWN, len(strokes.samples.path))))
        kept[f"{name}_after"] = _bytes(samples.after)
        kept[f"{name}_path"] = samples.view.to_pixels(samples.path[..., 1:3]).numpy()
        kept[f"{name}_valid"] = samples.valid.numpy() > 0
    np.savez_compressed(out / "measured.npz", **kept)


def _bytes(images: Tensor) -> np.ndarray:
    return (images.detach().clamp(0, 1) * 255).round().byte().numpy()
