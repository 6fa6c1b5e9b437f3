"""The stage evaluate_copainting, from scenes, co-paintings and four models to the table, pictures and pages."""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
import torch
from ruamel.yaml import YAML

from pentimento.contracts import copaintings, scenes
from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.images import decode_png, encode_png, read_image
from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.tables import write_table
from pentimento.copainting.drawings.pairs import DrawnScenesConfig, drawn_scenes
from pentimento.copainting.goal.planner import save_goal_planner
from pentimento.copainting.scenes.procedural import ScenesConfig, build_scenes
from pentimento.dynamics.strokes.extended import base_model, model_files
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from pentimento.semantics.encoder import Encoder, EncoderShape, new_model
from pentimento.semantics.tokenizer import learn_tokenizer
from pipelines import evaluate_copainting
from tests.copainting.goal_planners import small_planner
from tests.pipelines.conftest import Enter

SIDE_PX = 32
PLANNER: dict[str, Any] = {
    "initialisation": "error_guided", "candidates": 2, "rounds": 1, "sizes": [0.5, 0.5], "iterations_per_round": 2,
    "iterations_free": 2, "iterations_palette": 0, "iterations_replan": 1, "replan_rate": 0.3, "relocate_every": 0,
    "relocate_share": 0.0, "min_gain_per_stroke": 0.0,
    "palette": {"source": "ink", "size": None, "picture": None, "colors_srgb": None}, "sweeps": 1, "path_points": 8,
    "pixels_per_m": 400, "edge_m": "3 mm", "distances_px": [1, 2],
    "objectives": {"print_weight": 1.0, "semantic_weight": 0.0, "text": None, "style": None},
    "execution_noise": {"thinning": 0.0, "shift_m": "0 mm"},
    "learning_rates": {
        "middle_m": "0.8 mm", "theta_rad": 0.04, "length_m": "0.8 mm", "bend_m": "0.5 mm", "press_m": "0.02 mm",
        "color": 0.0,
    },
    "seed": 0,
}  # fmt: skip
INK = {"line_m": "1 mm", "contrast": 0.15, "tone": 0.3}
MARKER = {"tool": "marker", "side_m": "100 mm", "words": "with a marker", "ink": INK, "planner": PLANNER}
BRUSH = {
    "tool": "round_brush", "side_m": "100 mm", "words": "in colours", "ink": None,
    "planner": PLANNER
    | {"iterations_palette": 2, "palette": {"source": "plan", "size": 2, "picture": None, "colors_srgb": None}},
}  # fmt: skip
SECTION: dict[str, Any] = {
    "prompts": 3,
    "blank_canvas_prompts": 2,
    "ordinary_scenes": 3,
    "other_medium_prompts": 2,
    "executed_prompts": 1,
    "strokes": {"begun": 5, "added": 6},
    "sampling": {"steps": 1, "image_guidance": 1.0, "text_guidance": 1.0, "seed": 0},
    "text_only": {"iterations": 2, "views": 0},
    "codrawing": {
        "stories": 1,
        "person_strokes": 3,
        "robot_strokes": 3,
        "tremor_m": "0.5 mm",
        "replan_every": 5,
        "wishes": 2,
        "largest": 0.5,
    },
    "figures": {"method_rows": 2, "preference_prompts": 2},
    "workers": 1,
    "seed": 0,
    "settings": {"marker": {"world": "marker", "medium": MARKER}},
    "other_media": {"marker": BRUSH},
}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All that the stage reads, made small; every network is untrained."""
    folder = tmp_path_factory.mktemp("inputs")
    drawn = build_scenes(ScenesConfig(60, SIDE_PX, 0.1, 0.4, 4, 0), lambda *_: None)
    write_table(folder / "scenes", drawn, scenes.CONTRACT, "# Card")
    write_table(folder / "copaintings", pairs_of_scenes(drawn), copaintings.CONTRACT, "# Card")
    for seed, name in enumerate(("base", "fine")):
        save_goal_planner(small_planner(seed), folder / name)
    tokenizer = learn_tokenizer(drawn["caption"].to_pylist(), 60, 16)
    for seed, name in enumerate(("semantics", "judge")):
        (folder / name).mkdir()
        shape = EncoderShape(16, 8, 32, 1, 16, 1, 2, 16)
        Encoder(new_model(shape, tokenizer, seed), tokenizer).save(folder / name)
    for tool, width_m in (("marker", 2e-3), ("round_brush", 3e-3)):
        weights = folder / "models" / f"stroke_{tool}" / "weights"
        weights.mkdir(parents=True)
        model = base_model(Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 0.1, width_m, 0.2, 0.95))
        for file, content in model_files(model).items():
            (weights / file).write_text(json.dumps(content))
    return folder


def pairs_of_scenes(drawn: pa.Table) -> pa.Table:
    """Co-paintings whose full paintings are scenes in grey, whose partial ones blank."""
    template = copaintings.example_table(1).to_pylist()[0]
    blank = np.full((SIDE_PX, SIDE_PX, 3), 250, np.uint8)
    rows = [
        template
        | {
            "scene_id": row["scene_id"], "strategy": "all", "region": None, "caption": row["caption"],
            "partial": {"bytes": encode_png(blank), "path": None}, "full": {"bytes": grey(row), "path": None},
        }
        for row in drawn.to_pylist()[:10]
    ]  # fmt: skip
    return pa.Table.from_pylist(rows, schema=arrow_schema(copaintings.CONTRACT))


def grey(row: dict[str, Any]) -> bytes:
    image = decode_png(row["image"]["bytes"])
    return encode_png(np.repeat(image.mean(-1, keepdims=True), 3, -1).astype(np.uint8))


@pytest.fixture
def folder(stage_folder: Path, inputs: Path) -> Path:
    write_params({})
    return inputs


def write_params(changes: dict[str, Any]) -> None:
    YAML(typ="safe").dump({"evaluate_copainting": SECTION | changes}, Path("params.yaml"))


def evaluate(inputs: Path, out: str = "out", **changes: Any) -> Path:
    arguments: dict[str, Any] = {
        "setting": "marker", "scenes": inputs / "scenes", "copaintings": inputs / "copaintings",
        "base": inputs / "base", "fine_tuned": inputs / "fine", "semantics": inputs / "semantics",
        "judge": inputs / "judge", "models": inputs / "models", "tools": ["marker", "round_brush"], "out": Path(out),
    }  # fmt: skip
    torch.manual_seed(1)  # nothing may depend on it
    evaluate_copainting.main(argparse.Namespace(**arguments | changes))
    return Path(out)


@pytest.fixture(scope="module")
def evaluated(inputs: Path, tmp_path_factory: pytest.TempPathFactory, enter: Enter) -> Path:
    """What the stage writes with one worker."""
    place = tmp_path_factory.mktemp("evaluated")
    with pytest.MonkeyPatch.context() as patch:
        enter(place, patch)
        write_params({})
        return place / evaluate(inputs)


def test_every_number_has_its_baselines_beside_it(evaluated: Path) -> None:
    out = evaluated
    metrics = json.loads((out / "metrics.json").read_text())
    table = metrics["begun"]
    assert set(table) == set(evaluate_copainting.ON_CANVAS)
    scores = {"clip_score", "judge_score", "objects", "drawing_keeps", "changed", "strokes"}
    gaps = {"delta_pix", "delta_sem", "goal_keeps"}
    for method, row in table.items():
        assert set(row) == (scores if method in ("no_change", "text_only") else scores | gaps), method
        assert all(cell["low"] <= cell["value"] <= cell["high"] for cell in row.values())
    assert table["no_change"]["changed"]["value"] == 0 and table["no_change"]["drawing_keeps"]["value"] == 1
    copied = table["copy_input"]
    assert copied["delta_pix"]["value"] == 0 and abs(copied["delta_sem"]["value"]) < 1e-5
    assert copied["strokes"]["value"] == 0 and copied["clip_score"] == table["no_change"]["clip_score"]
    assert 0 < table["oracle"]["delta_pix"]["value"] < table["ignore_input"]["delta_pix"]["value"]
    assert set(metrics["comparisons"]) >= {"delta_pix_closed", "delta_sem_closed", "delta_pix_ratio"}
    ordinary = metrics["ordinary"]
    assert set(ordinary) >= {"judge_score", "copy_input", "target", "judge_score_over_copy_input"}
    gained = ordinary["judge_score"]["value"] - ordinary["copy_input"]["value"]
    assert abs(ordinary["judge_score_over_copy_input"]["value"] - gained) < 1e-6
    assert set(metrics["on_paper"]) == {"no_change", "base", "fine_tuned", "oracle"}
    assert set(metrics["other_medium"]) == {"no_change", "base", "fine_tuned"}
    assert set(metrics["correlation"]) == {"delta_pix", "delta_sem"}
    assert metrics["correlation"]["delta_pix"]["paintings"] == 10
    assert set(metrics["vae_ink_recall"]) == {"base", "fine_tuned"}
    for played in metrics["turns"].values():
        assert len(played) == 3 and all(turn["strokes"] >= 0 for turn in played)
    cases = json.loads((out / "cases.json").read_text())
    assert len(cases) == 3
    mean = np.mean([case["fine_tuned"]["judge_score"] for case in cases])
    assert abs(mean - table["fine_tuned"]["judge_score"]["value"]) < 1e-6
    for name in ("begun", "on_paper", "other_medium", "turns", "turns_base", "executed"):
        assert read_image(out / f"{name}.png").std() > 0
    key = json.loads((out / "preference_key.json").read_text())
    page = (out / "preference.html").read_text()
    ((name, parts),) = key["pages"].items()
    assert name in page and len(parts) == 4 and all(f'data-id="{part}"' in page for part in parts)
    assert {len({*part["shown"], "fine_tuned"}) for part in parts.values()} == {2}
    assert "fine_tuned" not in page and "text_only" not in page


@pytest.mark.timeout(400)  # two processes load PyTorch and diffusers
def test_the_same_bytes_again_and_with_two_workers(folder: Path, evaluated: Path) -> None:
    write_params({"workers": 2})
    two = evaluate(folder, "two")
    assert {f.name: f.read_bytes() for f in evaluated.iterdir()} == {f.name: f.read_bytes() for f in two.iterdir()}


def test_named_things_are_asked_for_on_canvases_that_others_began(folder: Path) -> None:
    config = DrawnScenesConfig(
        scenes=60, side_px=SIDE_PX, val_share=0.1, test_share=0.6, pen_share=0.0, wordings=2, alone_share=0.2,
        mirrored_share=0.0, places="usual", tinted_share=0.0, sources=("openmoji",), seed=0,
    )  # fmt: skip
    write_table(Path("scenes"), drawn_scenes(config, None), scenes.CONTRACT, "# Card")
    marker = SECTION["settings"]["marker"] | {"medium": MARKER | {"ink": None}}
    write_params({"settings": {"marker": marker}})
    out = evaluate(folder, "named", scenes=Path("scenes"))
    metrics = json.loads((out / "metrics.json").read_text())
    assert set(metrics["overlapping"]) == {"no_change", "base", "fine_tuned", "oracle"}
    kinds = {"begun", "overlapping", "on_paper", "composed_seen", "composed_held_out"}
    assert set(metrics["executed"]) == kinds
    assert all(0 <= found["low"] <= found["value"] <= found["high"] <= 1 for found in metrics["executed"].values())
    assert {"composed_seen", "composed_held_out"} <= set(metrics)
    for played in metrics["turns"].values():
        assert len(played) == 2
        assert played[0]["covered"] <= played[1]["covered"] and 0 <= played[1]["first_found"] <= 1
    assert set(json.loads((out / "cases.json").read_text())[0]) >= {"caption", "fine_tuned"}
    assert read_image(out / "overlapping.png").std() > 0


def test_a_tool_without_a_model_is_one_sentence(folder: Path) -> None:
    with pytest.raises(ConfigError, match="hands the stage models of marker only"):
        evaluate(folder, tools=["marker"])


def test_co_paintings_without_a_blank_sheet_are_refused(folder: Path, tmp_path: Path) -> None:
    table = copaintings.example_table(10)
    keep = pa.array([strategy != "all" for strategy in table["strategy"].to_pylist()])
    write_table(tmp_path / "few", table.filter(keep), copaintings.CONTRACT, "# Card")
    with pytest.raises(ContractError, match="No co-painting begins on a blank sheet"):
        evaluate(folder, copaintings=tmp_path / "few")
    assert not Path("out").exists()
