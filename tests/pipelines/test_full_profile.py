"""`PROFILE=full` from published folders to the runner: tiny networks in the published layouts, and a generated COCO."""

import argparse
import io
import json
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import numpy as np
import pytest
import torch
from PIL import Image
from ruamel.yaml import YAML
from transformers import CLIPConfig, CLIPModel

from pentimento.bundle.graphs import Graphs, goal_networks, noise_schedule, tokenizer
from pentimento.bundle.reader import open_bundle
from pentimento.bundle.sampler import complete as complete_lean
from pentimento.bundle.sampler import normal, seed_for
from pentimento.contracts.images import decode_png
from pentimento.copainting.goal.planner import (
    GoalPlannerShape,
    SeededSampling,
    build_goal_planner,
    complete,
    load_goal_planner,
    save_goal_planner,
    text_encoder_of,
)
from pentimento.copainting.goal.vae import VaeConfig, build_vae
from pentimento.copainting.scenes.procedural import ScenesConfig
from pentimento.copainting.scenes.procedural import build_scenes as drawn_scenes
from pentimento.dynamics.strokes.extended import base_model, model_files
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from pentimento.semantics.encoder import Encoder
from pentimento.semantics.tokenizer import learn_tokenizer
from pipelines import (
    build_scenes,
    deploy,
    evaluate_copainting,
    finetune_goal_planner,
    pretrain_goal_planner,
    synthesize_copaintings,
    train_semantics,
)
from pipelines._params import merge, overlaid
from tests.pipelines.conftest import Enter

SIDE_PX = 64
STEPS = 2
PLANNER: Final = {"iterations_free": 2, "rounds": 1, "iterations_per_round": 2, "path_points": 6}
SAMPLING: Final = {"steps": STEPS, "shown": 1, "scored": 2}
SMALL: Final = {
    "build_scenes": {"imported": {"side_px": SIDE_PX, "max_scenes": 40, "val_share": 0.15, "test_share": 0.25}},
    "train_semantics": {"test_scenes": 4, "retrieval_candidates": 2},
    "synthesize_copaintings": {
        "scenes": {"train": 4, "val": 2, "test": 2},
        # Words of untrained networks say nothing.
        "threshold": {"score": -1.0},
        "settings": {
            "marker": {
                "strokes": 6, "picture_px": SIDE_PX, "guidance": {"iterations": 1},
                "planner": PLANNER | {"pixels_per_m": SIDE_PX / 0.12},
            },
        },
    },
    "pretrain_goal_planner": {"sampling": SAMPLING},
    "finetune_goal_planner": {"training": {"steps": 3, "batch": 2, "checkpoint_every": 2}, "sampling": SAMPLING},
    "evaluate_copainting": {
        "prompts": 2, "blank_canvas_prompts": 1, "ordinary_scenes": 2, "other_medium_prompts": 1,
        "strokes": {"begun": 3, "added": 4}, "sampling": {"steps": STEPS}, "text_only": {"iterations": 1},
        "codrawing": {"person_strokes": 3, "robot_strokes": 3, "wishes": 1}, "workers": 1,
        "figures": {"method_rows": 1, "preference_prompts": 1},
        "settings": {"marker": {"medium": {"planner": PLANNER | {"pixels_per_m": SIDE_PX / 0.12}}}},
        "other_media": {"marker": {"planner": PLANNER | {"pixels_per_m": SIDE_PX / 0.12, "iterations_palette": 1}}},
    },
    "deploy": {
        "sampling": {"steps": STEPS}, "half_tolerance": 0.05,
        "settings": {"marker": {"strokes": 4, "planner": {"path_points": 6, "pixels_per_m": SIDE_PX / 0.12}}},
    },
}  # fmt: skip
"""What makes the profile small; all that is published or odd stays."""

pytestmark = pytest.mark.timeout(900)


def jpeg(picture: np.ndarray, mode: str) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(picture).convert(mode).save(stream, "JPEG")
    return stream.getvalue()


def write_coco(folder: Path) -> int:
    """A data set in COCO's layout with what is odd in the real one; returns how many pictures can be used."""
    scenes = drawn_scenes(ScenesConfig(36, SIDE_PX, 0.1, 0.1, 5, 0), lambda *_: None).to_pylist()
    for part in ("train2017", "val2017", "annotations"):
        (folder / part).mkdir(parents=True)
    usable = 0
    for part, some in (("train2017", scenes[:28]), ("val2017", scenes[28:])):
        images: list[dict[str, Any]] = []
        captions: list[dict[str, Any]] = []
        for number, scene in enumerate(some):
            name = f"{number:012d}.jpg"
            picture = decode_png(scene["image"]["bytes"])
            images.append({"id": number, "file_name": name, "height": SIDE_PX, "width": SIDE_PX, "license": 3})
            mode = {3: "L", 4: "CMYK"}.get(number, "RGB")
            if number != 5:  # the file is missing
                (folder / part / name).write_bytes(jpeg(picture, mode))
            if number != 6:  # nobody described it
                captions += [
                    {"id": 100 * number + i, "image_id": number, "caption": f"{text.capitalize()}. "}
                    for i, text in enumerate(scene["captions"][:5])
                ]
            usable += number not in (4, 5, 6)
        content = {"info": {"year": 2017}, "licenses": [], "images": images, "annotations": captions}
        (folder / f"annotations/captions_{part}.json").write_text(json.dumps(content))
        crowd = {"image_id": 0, "iscrowd": 1, "segmentation": {"counts": [0, 9], "size": [3, 3]}, "bbox": [0, 0, 3, 3]}
        (folder / f"annotations/instances_{part}.json").write_text(json.dumps(content | {"annotations": [crowd]}))
    return usable


def write_published(folder: Path) -> int:
    """The folders that docs/scale.md lists; returns how many pictures can be used."""
    usable = write_coco(folder / "coco2017")
    words = learn_tokenizer(["a red disc and a blue square", "a house beside a tree", "the sun above a boat"], 60, 77)
    text = {
        "vocab_size": len(words), "hidden_size": 16, "intermediate_size": 32, "num_hidden_layers": 2,
        "num_attention_heads": 2, "projection_dim": 16, "bos_token_id": words.bos_token_id,
        "eos_token_id": words.eos_token_id, "pad_token_id": words.pad_token_id,
    }  # fmt: skip
    for name, patch in (("clip-vit-base-patch32", 16), ("clip-vit-large-patch14", 8)):
        vision = {
            "hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 2, "num_attention_heads": 2,
            "image_size": 32, "patch_size": patch, "projection_dim": 16,
        }  # fmt: skip
        (folder / name).mkdir()
        clip = CLIPModel(CLIPConfig(text_config=text, vision_config=vision, projection_dim=16))
        Encoder(clip, words).save(folder / name)
    vae = build_vae(VaeConfig((8, 8, 8), 4, pictures=1, steps=1, batch=1, learning_rate=1e-3), SIDE_PX)
    planner = build_goal_planner(
        GoalPlannerShape((8, 16), 1, 2, "epsilon"), vae, text_encoder_of(clip), tokenizer=words, seed=0
    )
    save_goal_planner(planner.to(dtype=torch.float16), folder / "instruct-pix2pix")
    sampler = {
        "_class_name": "EulerAncestralDiscreteScheduler", "beta_start": 0.00085, "beta_end": 0.012,
        "beta_schedule": "scaled_linear", "num_train_timesteps": 1000, "prediction_type": "epsilon", "steps_offset": 1,
    }  # fmt: skip
    (folder / "instruct-pix2pix/scheduler/scheduler_config.json").write_text(json.dumps(sampler))
    return usable


def run(stage: ModuleType, **arguments: Any) -> None:
    stage.main(argparse.Namespace(**arguments))


def write_stroke_models(folder: Path) -> None:
    for tool, width_m in (("marker", 1e-3), ("round_brush", 3e-3)):
        weights = folder / f"stroke_{tool}" / "weights"
        weights.mkdir(parents=True)
        model = base_model(Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 0.1, width_m, 0.2, 0.95))
        for file, content in model_files(model).items():
            (weights / file).write_text(json.dumps(content))


def test_published_folders_become_a_bundle_that_plans_goals_as_the_workshop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, enter: Enter
) -> None:
    root = Path.cwd()
    params = merge(overlaid(root, "full"), SMALL, Path("SMALL"))
    params["deploy"] |= {"clays": {}, "settings": {"marker": params["deploy"]["settings"]["marker"]}}
    folder = tmp_path / ".profiles/full"
    folder.mkdir(parents=True)
    usable = write_published(tmp_path / "published")
    enter(folder, monkeypatch)
    YAML(typ="safe").dump(params, folder / "params.yaml")
    write_stroke_models(folder / "models")
    models = {"models": Path("models"), "tools": ["marker", "round_brush"]}
    scenes, semantics, judge = Path("scenes"), Path("semantics"), Path("judge")
    pairs, base, goal = Path("copaintings"), Path("goal_base"), Path("goal")

    run(build_scenes, out=scenes)
    metrics = json.loads((scenes / "metrics.json").read_text())
    assert metrics["scenes"] == usable and metrics["quarantined"]["all"] == 36 - usable
    run(
        train_semantics, params=Path("params.yaml"), scenes=scenes, judge_scenes=None, base=None, semantics=semantics,
        judge=judge,
    )  # fmt: skip
    run(synthesize_copaintings, setting="marker", scenes=scenes, semantics=semantics, out=pairs / "marker", **models)
    run(pretrain_goal_planner, scenes=scenes, semantics=semantics, base=None, out=base)
    run(finetune_goal_planner, copaintings=pairs, settings=["marker"], base=base, out=goal)
    run(
        evaluate_copainting, setting="marker", scenes=scenes, copaintings=pairs / "marker", base=base, fine_tuned=goal,
        semantics=semantics, judge=judge, out=Path("evaluation"), **models,
    )  # fmt: skip
    run(deploy, materials=[], semantics=semantics, goal=goal, hands=None, out=Path("bundle"), **models)

    bundle = open_bundle(Path("bundle"))
    facts, canvas = bundle.manifest.goal, np.full((1, SIDE_PX, SIDE_PX, 3), 240, np.uint8)
    canvas[:, 20:30, 10:50] = 30
    cells = SIDE_PX // facts.latent_step_px
    words = tokenizer(bundle, facts.words)
    lean = complete_lean(
        goal_networks(Graphs(bundle)), noise_schedule(bundle), canvas, tokens=words.encode(["a tree"]),
        no_words=words.encode([""]), noise=normal((1, facts.latent_channels, cells, cells), seed_for(0, 0)),
        steps=facts.steps, image_guidance=facts.image_guidance, text_guidance=facts.text_guidance,
    )  # fmt: skip
    sampling = SeededSampling(facts.steps, facts.image_guidance, facts.text_guidance, seed=0)
    workshop = complete(load_goal_planner(goal), canvas, ["a tree"], sampling)
    assert np.abs(lean.astype(int) - workshop).mean() < 2  # of 255, in half precision
    assert lean.std() > 0
