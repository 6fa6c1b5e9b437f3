"""The stage train_stroke_dynamics: a table of strokes becomes a model, its baselines, scores and a card."""

import argparse
import json
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from pentimento.contracts.strokes import CONTRACT, example_table
from pentimento.contracts.tables import write_table
from pipelines._imports import ROOT
from pipelines._params import read_params
from pipelines.train_stroke_dynamics import main


@pytest.mark.parametrize(
    ("given", "pixels_per_m", "margin_m"),
    [({}, 1000.0, 0.012), ({"pixels_per_m": 500, "margin_m": "5 mm"}, 500.0, 0.005)],
    ids=["auto", "numbers"],
)
def test_card_states_the_sampling_at_which_the_scores_are_taken(
    given: dict[str, Any], pixels_per_m: float, margin_m: float, stage_folder: Path
) -> None:
    section = read_params(ROOT / "params.yaml")["train_stroke_dynamics"]
    section |= {"epochs": 3, "path_points": 12} | given
    YAML(typ="safe").dump({"train_stroke_dynamics": section}, stage_folder / "params.yaml")
    write_table(stage_folder / "strokes", example_table(16), CONTRACT, "# Card")
    out = stage_folder / "weights"
    main(argparse.Namespace(tool="round_brush", strokes=stage_folder / "strokes", out=out))
    metrics = json.loads((out / "metrics.json").read_text())
    sampling = metrics["sampling"]
    assert sampling["pixels_per_m"] == pytest.approx(pixels_per_m, rel=1e-3)
    assert sampling["margin_m"] == pytest.approx(margin_m)
    assert 1e-3 < sampling["line_width_m"] < 5e-3
    card = (out / "card.md").read_text()
    assert f"at {pixels_per_m / 1e3:.3g} px/mm" in card and f"up to {1e3 * margin_m:.3g} mm of paper" in card
    for name in ("model", "polyline"):
        score = metrics["held_out"][name]
        assert f"| {name} | {score['iou']:.3f} | {score['l1']:.4f} | {score['mse']:.5f} |" in card
