"""The stages gather_demonstrations, train_trajvae and draw_in_hands: one after another, small."""

import argparse
import json
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML

import pentimento.handwriting.subjects as subjects
import pipelines.draw_in_hands as draw
import pipelines.draw_subjects_in_hands as draw_subjects
import pipelines.gather_demonstrations as gather
import pipelines.train_trajvae as train
from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.images import read_image
from pentimento.contracts.plan import read_plan
from pentimento.dynamics.strokes.extended import base_model, model_files
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from pentimento.semantics.encoder import Encoder, EncoderShape, new_model
from pentimento.semantics.tokenizer import learn_tokenizer
from pipelines._config import load_section
from pipelines._io import write_json

COURSE = {"steps": 40, "batch": 16, "rate": 0.002}
SECTIONS = {
    "gather_demonstrations": {
        "points": 16,
        "sources": [],
        "synthetic": {"sessions": 2, "strokes": 14, "seed": 3},
        "limits": {
            "max_gap_samples": 5, "jump_m": "3 mm", "jump_factor": 8.0, "shortest_m": "1 mm", "longest_m": "600 mm",
        },
    },
    "train_trajvae": {
        "few_shot_strokes": 10,
        "mapped_strokes": 40,
        "model": {
            "points": 16, "latent": 8, "width": 32, "kl_weight": 3e-4, "pretraining": COURSE, "fine_tuning": COURSE,
            "augmentation_std": 0.05, "seed": 1,
        },
    },
    "draw_in_hands": {
        "seed": 7, "views": 1, "settings": {
            "portrait": {
                "photograph": "astronaut", "part": {"left": 0.0, "top": 0.0, "right": 1.0, "bottom": 1.0},
                "tool": "marker", "world": "marker", "darkest": 0.35, "ink_length_m": 0.2, "replan_every": 6,
                "planner": {
                    "candidates": 2, "rounds": 1, "iterations_per_round": 2, "iterations": 4, "iterations_palette": 0,
                    "iterations_replan": 1, "replan_rate": 0.1, "relocate_every": 2, "relocate_share": 0.2,
                    "max_latent_distance": 1.0, "sweeps": 1, "path_points": 16, "pixels_per_m": 300.0,
                    "palette": {"source": "ink", "size": None, "picture": None, "colors_srgb": None},
                    "edge_m": "6 mm", "distances_px": [2], "seed": 1,
                    "objectives": {"print_weight": 1.0, "semantic_weight": 0.1, "text": None, "style": None},
                    "learning_rates": {
                        "middle_m": "0.8 mm", "theta_rad": 0.05, "press_m": "0.02 mm", "shape": 0.05, "color": 0.0,
                    },
                },
            },
        },
    },
}  # fmt: skip
PORTRAIT = SECTIONS["draw_in_hands"]["settings"]["portrait"]
SECTIONS["draw_subjects_in_hands"] = {
    "seed": 7, "views": 1, "settings": {
        "marker": {
            "tool": "marker", "world": "marker", "side_m": "80 mm", "subjects": 1, "ink_length_m": 0.3,
            "replan_every": 100, "planner": PORTRAIT["planner"],
        },
    },
}  # fmt: skip


@pytest.fixture
def folder(stage_folder: Path) -> Path:
    YAML(typ="safe").dump(SECTIONS, stage_folder / "params.yaml")
    return stage_folder


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def test_from_made_up_hands_to_drawings(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("one", "other"):
        gather.main(argparse.Namespace(out=folder / name / "demonstrations"))
        train.main(
            argparse.Namespace(demonstrations=folder / name / "demonstrations", out=folder / name / "hands")
        )  # fmt: skip
    assert bytes_of(folder / "one") == bytes_of(folder / "other")
    told = json.loads((folder / "one/hands/metrics.json").read_text())
    assert told["strokes"] == {"learned": 70, "quarantined": 0}
    assert all(told["arcs"][name] > 0 for name in ("fine_tuned", "pretrained", "nearest_demonstration", "mean_stroke"))
    card = (folder / "one/hands/card.md").read_text()
    for hand in ("arcs", "dots", "hatching", "loops", "zigzags"):
        steps = told[hand]["fine_tuning_steps"]
        says = f"fine-tuned on 10 strokes for {steps} of 40 steps" if steps else "the pretrained weights are kept"
        assert f"- **{hand}**: {says}" in card
        assert steps or told[hand]["fine_tuned"] == told[hand]["pretrained"]

    weights = folder / "models/stroke_marker/weights"
    weights.mkdir(parents=True)
    model = base_model(Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 0.5, 8e-4, 0.2, 0.95))
    for name, value in model_files(model).items():
        write_json(weights / name, value)
    (folder / "judge").mkdir()
    tokenizer = learn_tokenizer(["a house", "a red house"], 300, 24)
    Encoder(new_model(EncoderShape(32, 8, 32, 1, 32, 1, 2, 16), tokenizer, 0), tokenizer).save(folder / "judge")
    out = folder / "drawings"
    draw.main(
        argparse.Namespace(
            setting="portrait", demonstrations=folder / "one/demonstrations", hands=folder / "one/hands",
            models=folder / "models", tools=["marker"], semantics=folder / "judge", judge=folder / "judge", out=out,
        )
    )  # fmt: skip
    metrics = json.loads((out / "metrics.json").read_text())
    taken = metrics["taken_for"]
    for shares in taken["executed"].values():
        assert sum(shares) == pytest.approx(1)
    assert taken["diagonal_people"] > 0.8
    for name, error in metrics["error"].items():
        assert name == "blank" or error < metrics["error"]["blank"]
    height, width = read_image(out / "target.png").shape[:2]
    assert read_image(out / "drawings.png").shape[:2] == (2 * height, 4 * width)
    drawn = read_plan(out / "dots/plan.jsonl")
    assert len(drawn.strokes) == metrics["strokes"]["dots"]
    lengths = [np.linalg.norm(np.diff(stroke.path[:, 1:3], axis=0), axis=1).sum() for stroke in drawn.strokes]
    assert sum(lengths) == pytest.approx(metrics["ink_length_m"]["dots"], rel=1e-6)

    # The judge here knows no thing, so that it cannot choose one.
    monkeypatch.setattr(subjects, "choose_subjects", lambda *_, **__: (["house"], 1.0))
    out = folder / "subjects"
    draw_subjects.main(
        argparse.Namespace(
            demonstrations=folder / "one/demonstrations", hands=folder / "one/hands", models=folder / "models",
            tools=["marker"], semantics=folder / "judge", judge=folder / "judge", out=out,
        )
    )  # fmt: skip
    found = json.loads((out / "metrics.json").read_text())["marker"]
    assert found["subjects"] == ["house"]
    assert set(found["named"]) == {*found["hands"], "bezier", "target", "blank"}
    assert found["own_strokes"] > 2 * found["chance"]["hand"]
    shown = read_image(out / "marker/contact_sheet.png")
    assert shown.shape == (2 * 240, (2 + len(found["hands"])) * 240, 3)
    assert min(shown[240:, at : at + 240].min() for at in range(0, shown.shape[1], 240)) < 100


def test_a_hand_without_strokes_to_measure_is_refused(folder: Path) -> None:
    sections = {**SECTIONS, "train_trajvae": {**SECTIONS["train_trajvae"], "few_shot_strokes": 14}}
    YAML(typ="safe").dump(sections, folder / "params.yaml")
    gather.main(argparse.Namespace(out=folder / "demonstrations"))
    with pytest.raises(ContractError, match=r"more than train_trajvae\.few_shot_strokes = 14"):
        train.main(argparse.Namespace(demonstrations=folder / "demonstrations", out=folder / "hands"))


@pytest.mark.parametrize(
    ("section", "key", "value", "kind", "sentence"),
    [
        ("gather_demonstrations", "points", 1, gather.GatherDemonstrations, "points is 1"),
        ("train_trajvae", "few_shot_strokes", 1, train.TrainTrajVAE, "few_shot_strokes is 1"),
        ("draw_in_hands", "views", -1, draw.DrawInHands, "views is -1; it must be 0 or more"),
        ("draw_subjects_in_hands", "views", -1, draw_subjects.DrawSubjectsInHands, "views is -1; it must be 0 or more"),
    ],
)
def test_a_number_out_of_its_range_is_one_sentence(
    folder: Path, section: str, key: str, value: object, kind: type, sentence: str
) -> None:
    YAML(typ="safe").dump({section: {**SECTIONS[section], key: value}}, folder / "params.yaml")
    with pytest.raises(ConfigError, match=sentence):
        load_section(folder / "params.yaml", section, kind)
