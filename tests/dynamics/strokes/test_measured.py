"""Robot strokes that others photographed: seven parameters must beat a constant-width polyline on held-out IoU."""

import os
from pathlib import Path

import pytest

from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.dynamics.strokes.evaluation import fit_polyline, mean_iou, predict_with, score_model
from pentimento.dynamics.strokes.samples import load_samples
from pentimento.dynamics.strokes.training import TrainingConfig, split_by_action, train

MEASURED = os.environ.get("PENTIMENTO_MEASURED")


@pytest.mark.skipif(not MEASURED, reason="PENTIMENTO_MEASURED does not name a folder of measured strokes")
@pytest.mark.parametrize(
    ("name", "margin_m", "better_by"), [("sharpie_short", 0.008, 0.01), ("brush_big_16x20", 0.02, 0.03)]
)
def test_the_model_beats_a_polyline_fitted_for_iou(name: str, margin_m: float, better_by: float) -> None:
    config = TrainingConfig(32, 2000.0, margin_m, 20, 16, 0.03, 2.0, 0.25, 0)
    table = read_table(Path(str(MEASURED)) / "frida_strokes" / f"{name}.parquet", CONTRACT).table
    samples = load_samples(table, config.path_points, config.pixels_per_m, config.margin_m)
    training, held_out = split_by_action(samples, config.held_out, config.seed)
    model = train(training, config, lambda *_: None).parameters_si()
    polyline = fit_polyline(lambda pen: -mean_iou(predict_with(pen, training), training))
    ours, trivial = score_model(model, held_out).iou, score_model(polyline, held_out).iou
    print(f"{name}: held-out IoU {ours:.3f}, polyline {trivial:.3f}")
    assert ours >= trivial + better_by
