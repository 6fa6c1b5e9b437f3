"""The stages pretrain_goal_planner and finetune_goal_planner: from scenes to a base, from co-paintings to a planner."""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from diffusers import (
    AutoencoderKL,
    EulerAncestralDiscreteScheduler,
    StableDiffusionInstructPix2PixPipeline,
    UNet2DConditionModel,
)
from ruamel.yaml import YAML
from transformers import CLIPTextConfig, CLIPTextModel

from pentimento.contracts import copaintings, scenes
from pentimento.contracts.errors import ConfigError
from pentimento.contracts.images import read_image
from pentimento.contracts.tables import write_table
from pentimento.copainting.goal.planner import SeededSampling, complete, load_goal_planner
from pentimento.semantics.tokenizer import learn_tokenizer
from pipelines import finetune_goal_planner, pretrain_goal_planner
from pipelines._tracking.families import experiment_of
from tests.copainting.goal_planners import small_encoder

TRAINING: dict[str, Any] = {
    "steps": 4, "batch": 2, "learning_rate": 1e-3, "warm_up": 1, "weight_decay": 0.01, "drop_text": 0.05,
    "drop_image": 0.05, "drop_both": 0.05, "min_snr_gamma": None, "time_bias": 1.0, "ema_decay": 0.9, "lora": None,
    "train_text": True, "checkpoint_every": 2, "gradient_checkpointing": False,
    "precision": "32-true", "accelerator": "cpu", "devices": 1,
    "strategy": "auto", "seed": 0,
}  # fmt: skip
SAMPLING: dict[str, Any] = {
    "steps": 2, "image_guidance": [1.0], "text_guidance": [2.0, 1.0], "shown": 2, "scored": 3, "enlarged": 2, "seed": 0,
}  # fmt: skip
PRETRAIN: dict[str, Any] = {
    "from_pretrained": None,
    "scenes": 6,
    "edits": 2,
    "shape": {"unet_channels": [8, 16], "unet_layers": 1, "heads": 2, "prediction": "sample"},
    "vae": {"channels": [8, 8], "latent_channels": 4, "pictures": 4, "steps": 3, "batch": 2, "learning_rate": 1e-3},
    "training": TRAINING,
    "sampling": SAMPLING,
    "threads": 1,
}  # fmt: skip
FINETUNE: dict[str, Any] = {
    "training": TRAINING | {"train_text": False},
    "decoder": {"steps": 3, "batch": 2, "learning_rate": 1e-3},
    "sampling": SAMPLING,
    "threads": 1,
}


@pytest.fixture
def folder(stage_folder: Path) -> Path:
    """Example scenes and co-paintings, and params.yaml."""
    write_table(stage_folder / "scenes", scenes.example_table(12), scenes.CONTRACT, "# Card")
    for setting in ("marker", "colour12"):
        write_table(
            stage_folder / "copaintings" / setting, copaintings.example_table(12), copaintings.CONTRACT, "# Card"
        )
    (stage_folder / "semantics").mkdir()
    small_encoder().save(stage_folder / "semantics")
    write_params()
    return stage_folder


def write_params(pretrain: dict[str, Any] | None = None, finetune: dict[str, Any] | None = None) -> None:
    sections = {
        "pretrain_goal_planner": PRETRAIN | (pretrain or {}),
        "finetune_goal_planner": FINETUNE | (finetune or {}),
    }
    YAML(typ="safe").dump(sections, Path("params.yaml"))


def pretrain(out: str = "base") -> Path:
    pretrain_goal_planner.main(
        argparse.Namespace(scenes=Path("scenes"), semantics=Path("semantics"), base=None, out=Path(out))
    )
    return Path(out)


def finetune(out: str = "fine") -> Path:
    arguments = argparse.Namespace(
        copaintings=Path("copaintings"), settings=["marker", "colour12"], base=Path("base"), out=Path(out)
    )
    finetune_goal_planner.main(arguments)
    return Path(out)


def contents(folder: Path) -> dict[str, bytes]:
    return {str(file.relative_to(folder)): file.read_bytes() for file in sorted(folder.rglob("*")) if file.is_file()}


def test_a_base_is_trained_and_fine_tuned_and_mlflow_has_it_all(folder: Path) -> None:
    from mlflow import MlflowClient

    base, fine = pretrain(), finetune()
    metrics = json.loads((base / "metrics.json").read_text())
    assert set(metrics["vae"]) == {"lines", "strokes"} and metrics["scenes"]["training"] == 6
    assert len(json.loads((base / "curve.json").read_text())["loss"]) == 4
    held_out = json.loads((fine / "metrics.json").read_text())["held_out"]
    assert held_out["base"]["mse_of_copying"] == held_out["fine_tuned"]["mse_of_copying"] > 0
    assert held_out["base"]["mse"] != held_out["fine_tuned"]["mse"]
    grid = read_image(fine / "guidance.png")
    assert grid.shape == (26 + 2 * (128 + 26), 4 * (128 + 4), 3)
    planner = load_goal_planner(fine)
    assert complete(
        planner, np.zeros((1, 64, 64, 3), np.uint8), ["a red disc"], SeededSampling(2, 1.0, 2.0, 0)
    ).shape == (1, 64, 64, 3)
    client = MlflowClient()
    runs = client.search_runs([client.get_experiment_by_name(experiment_of("finetune_goal_planner")).experiment_id])
    assert {run.data.tags["stage"] for run in runs} == {"pretrain_goal_planner", "finetune_goal_planner"}
    for run in runs:
        assert "loss" in run.data.metrics and run.inputs.dataset_inputs
        assert [item.path for item in client.list_artifacts(run.info.run_id, "pictures")] == ["pictures/guidance.png"]
        assert len(client.get_metric_history(run.info.run_id, "loss")) == 4
    assert not list(Path(".pentimento/training").rglob("*.ckpt"))  # scratch is gone when the work is done


def test_killed_and_started_again_gives_the_same_bytes(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from pipelines._tracking import Run

    whole_base, whole_fine = contents(pretrain()), contents(finetune())
    log = Run.log

    def die_at_step_3(self: Run, name: str, value: float, step: int | None = None) -> None:
        if name == "loss" and step == 3:
            raise SystemExit(143)  # as SIGTERM ends a stage
        log(self, name, value, step)

    for again, out in ((pretrain, "base_again"), (finetune, "fine_again")):
        monkeypatch.setattr(Run, "log", die_at_step_3)
        with pytest.raises(SystemExit):
            again(out)
        assert not Path(out).exists()
        assert len(list(Path(".pentimento/training").rglob("step-*.ckpt"))) == 1
        monkeypatch.setattr(Run, "log", log)
        again(out)
    assert contents(Path("base_again")) == whole_base
    assert contents(Path("fine_again")) == whole_fine


def published_layout(folder: Path) -> None:
    """A pipeline with every part and setting of timbrooks/instruct-pix2pix, its widths a tenth or so."""
    tokenizer = learn_tokenizer(["a red disc", "a blue square"], 40, 77)
    text = CLIPTextConfig(
        vocab_size=len(tokenizer), hidden_size=96, intermediate_size=384, num_hidden_layers=12, num_attention_heads=12,
        max_position_embeddings=77, projection_dim=96, hidden_act="quick_gelu", bos_token_id=tokenizer.bos_token_id,
        eos_token_id=tokenizer.eos_token_id, pad_token_id=tokenizer.pad_token_id,
    )  # fmt: skip
    unet = UNet2DConditionModel(
        sample_size=64, in_channels=8, out_channels=4, center_input_sample=False, flip_sin_to_cos=True, freq_shift=0,
        down_block_types=("CrossAttnDownBlock2D",) * 3 + ("DownBlock2D",),
        up_block_types=("UpBlock2D",) + ("CrossAttnUpBlock2D",) * 3, block_out_channels=(32, 64, 128, 128),
        layers_per_block=2, downsample_padding=1, mid_block_scale_factor=1, act_fn="silu", norm_num_groups=32,
        norm_eps=1e-5, cross_attention_dim=96, attention_head_dim=8,
    )  # fmt: skip
    vae = AutoencoderKL(
        down_block_types=("DownEncoderBlock2D",) * 4, up_block_types=("UpDecoderBlock2D",) * 4,
        block_out_channels=(32, 64, 64, 64), layers_per_block=2, latent_channels=4, norm_num_groups=32, sample_size=512,
        scaling_factor=0.18215,
    )  # fmt: skip
    scheduler = EulerAncestralDiscreteScheduler(
        num_train_timesteps=1000, beta_start=0.00085, beta_end=0.012, beta_schedule="scaled_linear", steps_offset=1
    )
    StableDiffusionInstructPix2PixPipeline(
        vae=vae, text_encoder=CLIPTextModel(text), tokenizer=tokenizer, unet=unet, scheduler=scheduler,
        safety_checker=None, feature_extractor=None, image_encoder=None, requires_safety_checker=False,
    ).save_pretrained(folder)  # fmt: skip


@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")  # of the published scheduler
@pytest.mark.parametrize("lora", [None, {"rank": 4, "alpha": 4}])
def test_a_base_in_the_published_layout_is_fine_tuned_by_one_setting(folder: Path, lora: dict[str, int] | None) -> None:
    torch.manual_seed(0)
    published_layout(folder / "published")
    training = TRAINING | {"steps": 2, "train_text": False, "lora": lora}
    write_params({"from_pretrained": "published"}, {"training": training, "decoder": None})
    base, fine = load_goal_planner(pretrain()), load_goal_planner(finetune())
    assert base.unet.config.in_channels == fine.unet.config.in_channels == 8
    first, second = (p.unet.state_dict() for p in (base, fine))
    published = load_goal_planner(folder / "published").unet.state_dict()
    assert all(torch.equal(published[name], first[name]) for name in published)  # nothing is trained, none rebuilt
    assert first.keys() == second.keys()
    assert not torch.equal(first["conv_in.weight"], second["conv_in.weight"])
    assert (first["conv_in.weight"] - second["conv_in.weight"]).abs().max() < 0.1
    assert fine.scheduler.config.prediction_type == "epsilon"


def test_a_base_that_is_no_instruct_pix2pix_is_a_sentence(folder: Path) -> None:
    write_params({"from_pretrained": "nobody/has-this"})
    with pytest.raises(ConfigError, match="nobody/has-this cannot be loaded"):
        pretrain()
    assert not Path("base").exists()
