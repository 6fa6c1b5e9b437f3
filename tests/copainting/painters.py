"""A painting setting with a marker, few strokes and an untrained encoder; a painting takes a fraction of a second."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from pentimento.contracts import scenes
from pentimento.copainting.scenes.ink import InkTones
from pentimento.copainting.synthesis.painter import Guidance, Setting
from pentimento.copainting.synthesis.partials import PartialsConfig
from pentimento.dynamics.strokes.extended import base_model, model_files
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from pentimento.planning.strokes.config import (
    PRINT_ALONE,
    ExecutionNoise,
    LearningRates,
    PlannerConfig,
)
from pentimento.planning.strokes.palette import PaletteChoice
from pentimento.semantics.encoder import Encoder, EncoderShape, new_model
from pentimento.semantics.tokenizer import learn_tokenizer

PARTIALS = PartialsConfig(2, (0.25, 0.75), (0.3,), 1, 0.5, 0.001)
PLANNER = PlannerConfig(
    initialisation="error_guided", candidates=2, rounds=1, sizes=(0.3, 0.3), iterations_per_round=2, iterations_free=4,
    iterations_palette=0, iterations_replan=1, replan_rate=0.3, relocate_every=2, relocate_share=0.2,
    min_gain_per_stroke=0.0,
    palette=PaletteChoice("ink", None, None, None), sweeps=1, path_points=6, pixels_per_m=600, edge_m=0.002,
    distances_px=(1, 3), objectives=PRINT_ALONE, execution_noise=ExecutionNoise(0.0, 0.0),
    learning_rates=LearningRates(8e-4, 0.04, 8e-4, 5e-4, 2e-5, 0.0), seed=1,
)  # fmt: skip
MARKER = Setting(
    tool="marker", canvas_m=(0.06, 0.06), picture_px=24, paper=0.98, strokes=8, words="with a marker",
    ink=InkTones(0.0015, 0.15, 0.3), guidance=Guidance(weight=0.02, iterations=2, rate=0.5, views=1), planner=PLANNER,
)  # fmt: skip
BRUSH = replace(
    MARKER, tool="round_brush", canvas_m=(0.16, 0.16), ink=None, guidance=None, planner=replace(
        PLANNER, pixels_per_m=200, iterations_palette=3, sweeps=2, palette=PaletteChoice("plan", 3, None, None),
        edge_m=0.006, learning_rates=LearningRates(2e-3, 0.1, 2e-3, 1e-3, 8e-4, 0.05),
    ),
)  # fmt: skip


def write_stroke_model(folder: Path) -> Path:
    """A straight model whose strokes are wide enough for small pictures."""
    folder.mkdir(parents=True)
    parameters = Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 1.0, 2e-3, 0.3, 0.9)
    for name, content in model_files(base_model(parameters)).items():
        (folder / name).write_text(json.dumps(content))
    return folder


def write_encoder(folder: Path) -> Path:
    """Untrained, for the example scenes' captions."""
    captions = sorted(set(scenes.example_table(40)["caption"].to_pylist()))
    shape = EncoderShape(
        image_px=16, patch_px=8, image_width=32, image_layers=2, text_width=16, text_layers=1, heads=2, embedding=16
    )
    tokenizer = learn_tokenizer(captions, 60, 24)
    folder.mkdir(parents=True)
    Encoder(new_model(shape, tokenizer, 0), tokenizer).save(folder)
    return folder


def section(setting: Setting = MARKER, **changes: Any) -> dict[str, Any]:
    """Section `synthesize_copaintings` of params.yaml with this setting as `marker`."""
    values: dict[str, Any] = {
        "scenes": {"train": 3, "val": 1, "test": 1},
        "half_scenes": {"train": 0, "val": 0, "test": 0},
        "pairs_per_half_scene": 0,
        "pairs_per_named_thing": 0,
        "scenes_per_shard": 2,
        "workers": 1,
        "scheduler": None,
        "threshold": {"score": None, "mismatched_quantile": 0.1, "seed": 0},
        "partials": asdict(PARTIALS),
        "settings": {"marker": asdict(setting)},
    }
    return json.loads(json.dumps(values | changes))
