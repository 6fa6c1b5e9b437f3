"""Saving, loading and checking a goal planner, and its completions."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.copainting.goal.denoising import tokens_of
from pentimento.copainting.goal.planner import (
    GoalPlanner,
    SeededSampling,
    complete,
    load_goal_planner,
    save_goal_planner,
)
from pipelines.export_base import copy_in_half_precision
from tests.copainting.goal_planners import CAPTIONS, SIDE_PX, small_encoder, small_planner


@pytest.fixture(scope="module")
def planner() -> GoalPlanner:
    return small_planner()


@pytest.fixture
def inputs() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (4, SIDE_PX, SIDE_PX, 3)).astype(np.uint8)


def test_saved_planner_names_no_folder_that_it_came_from(planner: GoalPlanner, tmp_path: Path) -> None:
    save_goal_planner(planner, tmp_path / "first")
    save_goal_planner(load_goal_planner(tmp_path / "first"), tmp_path / "second")
    configs = [file.read_text() for file in (tmp_path / "second").rglob("*.json")]
    assert not any(str(tmp_path) in text for text in configs)


def test_planner_in_half_precision_is_loaded_in_single_precision(planner: GoalPlanner, tmp_path: Path) -> None:
    save_goal_planner(planner, tmp_path / "whole")
    copy_in_half_precision(tmp_path / "whole", tmp_path / "half")
    loaded = load_goal_planner(tmp_path / "half")
    for name in ("unet", "vae", "text_encoder"):
        for one, other in zip(getattr(planner, name).parameters(), getattr(loaded, name).parameters(), strict=True):
            assert other.dtype == torch.float32
            assert torch.allclose(one, other, rtol=1e-3, atol=1e-6)
    sizes = [
        sum(file.stat().st_size for file in (tmp_path / name).rglob("*.safetensors")) for name in ("whole", "half")
    ]
    assert sizes[1] < 0.6 * sizes[0]


def test_saved_planner_completes_as_before(planner: GoalPlanner, inputs: np.ndarray, tmp_path: Path) -> None:
    save_goal_planner(planner, tmp_path / "planner")
    index = json.loads((tmp_path / "planner/model_index.json").read_text())
    assert index["_class_name"] == "StableDiffusionInstructPix2PixPipeline"
    assert not [file for file in (tmp_path / "planner").rglob("*") if file.suffix in (".bin", ".pt", ".ckpt")]
    loaded = load_goal_planner(tmp_path / "planner")
    before, after = (complete(p, inputs, CAPTIONS, SeededSampling(3, 1.2, 2.0, 0)) for p in (planner, loaded))
    assert (before == after).all() and before.shape == inputs.shape and before.dtype == np.uint8


def test_text_encoder_of_planner_equals_the_encoders_text_tower(planner: GoalPlanner) -> None:
    """The pooled caption, projected and normalised, is the encoder's own embedding; and the copy is a copy."""
    encoder = small_encoder()
    tokens = tokens_of(planner, list(CAPTIONS))
    pooled = planner.text_encoder(tokens).pooler_output
    own = torch.nn.functional.normalize(encoder.model.text_projection(pooled), dim=-1)
    assert torch.allclose(own, encoder.embed_texts(CAPTIONS), atol=1e-5)


def test_each_completion_starts_from_noise_of_its_index(planner: GoalPlanner, inputs: np.ndarray) -> None:
    same = np.repeat(inputs[:1], 2, axis=0)
    first, second = complete(planner, same, [CAPTIONS[0]] * 2, SeededSampling(3, 1.0, 1.0, 0))
    assert (first != second).any()
    alone = complete(planner, same[:1], CAPTIONS[:1], SeededSampling(3, 1.0, 1.0, 0))
    assert np.abs(alone[0].astype(int) - first).max() <= 1  # a batch may sum in another order
    assert (complete(planner, same[:1], CAPTIONS[:1], SeededSampling(3, 1.0, 1.0, 1))[0] != alone[0]).any()


def test_completion_depends_on_caption_and_canvas(planner: GoalPlanner, inputs: np.ndarray) -> None:
    plain = complete(planner, inputs[:1], ["a red disc"], SeededSampling(3, 1.0, 3.0, 0))
    assert (complete(planner, inputs[:1], ["a blue square"], SeededSampling(3, 1.0, 3.0, 0)) != plain).any()
    assert (complete(planner, inputs[1:2], ["a red disc"], SeededSampling(3, 1.0, 3.0, 0)) != plain).any()


@pytest.mark.parametrize("caption", ["", "чашка и дом", "a red disc " * 60, "🎨 ¿qué?"])
def test_completes_for_any_caption_text(planner: GoalPlanner, inputs: np.ndarray, caption: str) -> None:
    assert complete(planner, inputs[:1], [caption], SeededSampling(2, 1.5, 2.0, 0)).shape == (1, SIDE_PX, SIDE_PX, 3)


def test_rejects_picture_sizes_and_caption_counts_that_do_not_fit(planner: GoalPlanner) -> None:
    with pytest.raises(ContractError, match="multiples of 4"):
        complete(planner, np.zeros((1, 18, 16, 3), np.uint8), ["x"], SeededSampling(1, 1.0, 1.0, 0))
    with pytest.raises(ContractError, match="captions"):
        complete(planner, np.zeros((2, 16, 16, 3), np.uint8), ["x"], SeededSampling(1, 1.0, 1.0, 0))


def test_rejects_text_encoder_of_another_width(planner: GoalPlanner, tmp_path: Path) -> None:
    save_goal_planner(planner, tmp_path / "planner")
    small_planner(0, text_width=32).text_encoder.save_pretrained(tmp_path / "planner/text_encoder")
    with pytest.raises(ConfigError, match="16 text channels, but its text encoder has 32"):
        load_goal_planner(tmp_path / "planner")


@pytest.mark.parametrize("what", ["missing", "empty", "without unet", "cut"])
def test_rejects_incomplete_planner_folder(planner: GoalPlanner, tmp_path: Path, what: str) -> None:
    folder = tmp_path / "planner"
    if what == "empty":
        folder.mkdir()
    if what in ("without unet", "cut"):
        save_goal_planner(planner, folder)
        weights = folder / "unet/diffusion_pytorch_model.safetensors"
        content = weights.read_bytes()
        weights.unlink()
        if what == "cut":
            weights.write_bytes(content[: len(content) // 2])
    with pytest.raises(ConfigError, match="cannot be loaded as an Instruct-Pix2Pix pipeline"):
        load_goal_planner(folder)


def rewritten(file: Path, change: Callable[[dict[str, torch.Tensor]], dict[str, torch.Tensor]]) -> None:
    save_file(change(load_file(file)), file, {"format": "pt"})


UNET, VAE, TEXT = (
    f"{part}/model.safetensors" if part == "text_encoder" else f"{part}/diffusion_pytorch_model.safetensors"
    for part in ("unet", "vae", "text_encoder")
)


@pytest.mark.parametrize("file", [UNET, VAE, TEXT])
def test_a_part_that_is_not_whole_is_refused_by_name(planner: GoalPlanner, tmp_path: Path, file: str) -> None:
    save_goal_planner(planner, tmp_path)
    whole = (tmp_path / file).read_bytes()
    faults: tuple[tuple[Callable[[], object], str], ...] = (
        (lambda: (tmp_path / file).write_text("version https://git-lfs.github.com/spec/v1\n"), "is a pointer"),
        (lambda: (tmp_path / file).write_bytes(whole[: len(whole) * 6 // 10]), "is cut off or damaged"),
        (lambda: rewritten(tmp_path / file, lambda w: dict(list(w.items())[1:])), "lacks weights"),
        (lambda: rewritten(tmp_path / file, lambda w: {f"{n}_": v for n, v in w.items()}), "lacks weights"),
        (lambda: rewritten(tmp_path / file, lambda w: w | {"further.bias": torch.zeros(1)}), "has no place for"),
        (
            lambda: rewritten(tmp_path / file, lambda w: {n: torch.full_like(v, torch.nan) for n, v in w.items()}),
            "not finite",
        ),
    )
    for damage, sentence in faults:
        (tmp_path / file).write_bytes(whole)
        damage()
        with pytest.raises(ConfigError, match=f"{file.partition('/')[0]} cannot be read: .*{sentence}"):
            load_goal_planner(tmp_path)


@pytest.mark.parametrize("file", [UNET, VAE, TEXT])
def test_a_part_in_half_precision_is_asked_in_single_precision(
    planner: GoalPlanner, inputs: np.ndarray, tmp_path: Path, file: str
) -> None:
    save_goal_planner(planner, tmp_path)
    rewritten(tmp_path / file, lambda w: {name: value.half() for name, value in w.items()})
    config = tmp_path / "text_encoder/config.json"
    config.write_text(json.dumps(json.loads(config.read_text()) | {"dtype": "float16"}))
    loaded = load_goal_planner(tmp_path)
    parts = (loaded.unet, loaded.vae, loaded.text_encoder)
    assert {weight.dtype for part in parts for weight in part.parameters()} == {torch.float32}
    before, after = (complete(p, inputs[:1], CAPTIONS[:1], SeededSampling(3, 1.2, 2.0, 0)) for p in (planner, loaded))
    assert np.abs(before.astype(int) - after).mean() < 2


@pytest.mark.parametrize("missing", ["tokenizer/vocab.json", "scheduler/scheduler_config.json", "model_index.json"])
def test_a_folder_without_a_tokenizer_or_a_sampler_is_refused(
    planner: GoalPlanner, tmp_path: Path, missing: str
) -> None:
    save_goal_planner(planner, tmp_path)
    (tmp_path / missing).unlink()
    (tmp_path / "tokenizer/tokenizer.json").unlink()
    with pytest.raises(ConfigError, match="cannot be loaded as an Instruct-Pix2Pix pipeline"):
        load_goal_planner(tmp_path)


BETAS = {"beta_start": 0.00085, "beta_end": 0.012, "beta_schedule": "scaled_linear"}


@pytest.mark.parametrize(
    "name",
    [
        "EulerDiscreteScheduler",
        "EulerAncestralDiscreteScheduler",
        "DPMSolverMultistepScheduler",
        "UniPCMultistepScheduler",
        "LMSDiscreteScheduler",
        "PNDMScheduler",
        "DDPMScheduler",
        "DDIMScheduler",
        "HeunDiscreteScheduler",
        "DEISMultistepScheduler",
    ],
)
def test_whatever_the_sampler_was_ddim_does_not_clip_and_keeps_the_schedule(
    planner: GoalPlanner, tmp_path: Path, name: str
) -> None:
    save_goal_planner(planner, tmp_path)
    config = BETAS | {"_class_name": name, "num_train_timesteps": 1000, "timestep_spacing": "linspace"}
    (tmp_path / "scheduler/scheduler_config.json").write_text(json.dumps(config))
    loaded = load_goal_planner(tmp_path)
    config = loaded.scheduler.config
    kept = torch.cumprod(1 - torch.linspace(0.00085**0.5, 0.012**0.5, 1000) ** 2, dim=0)
    assert (config.clip_sample, config.thresholding, config.prediction_type) == (False, False, "epsilon")
    assert config.timestep_spacing == "leading"
    assert torch.allclose(loaded.scheduler.alphas_cumprod, kept)
    # A step from latents far outside -1 to 1 keeps them there.
    loaded.scheduler.set_timesteps(4)
    latents = torch.full((1, 4, 2, 2), 5.0)
    clean = loaded.scheduler.step(torch.zeros_like(latents), 1, latents).pred_original_sample
    assert torch.allclose(clean, latents / kept[1].sqrt())


def test_a_sampler_that_clips_no_longer_does_and_a_zero_end_is_trailing(planner: GoalPlanner, tmp_path: Path) -> None:
    save_goal_planner(planner, tmp_path)
    file = tmp_path / "scheduler/scheduler_config.json"
    clipping = {"_class_name": "DDIMScheduler", "clip_sample": True, "thresholding": True, "num_train_timesteps": 1000}
    zero_end = {"timestep_spacing": "linspace", "rescale_betas_zero_snr": True, "prediction_type": "v_prediction"}
    file.write_text(json.dumps(clipping | BETAS | zero_end))
    config = load_goal_planner(tmp_path).scheduler.config
    assert (config.clip_sample, config.thresholding, config.timestep_spacing) == (False, False, "trailing")


@pytest.mark.parametrize(
    ("config", "sentence"),
    [
        ({"_class_name": "FlowMatchEulerDiscreteScheduler", "shift": 3.0}, "has no noise schedule"),
        ({"_class_name": "EDMEulerScheduler", "sigma_min": 0.002}, "has no noise schedule"),
        (BETAS | {"_class_name": "LCMScheduler"}, "of a distilled model"),
        (BETAS | {"_class_name": "DPMSolverMultistepScheduler", "prediction_type": "flow_prediction"}, "'flow_predict"),
        (BETAS | {"_class_name": "DPMSolverMultistepScheduler", "beta_schedule": "laplace"}, "laplace"),
    ],
)
def test_a_sampler_without_such_a_schedule_is_refused(
    planner: GoalPlanner, tmp_path: Path, config: dict[str, object], sentence: str
) -> None:
    save_goal_planner(planner, tmp_path)
    (tmp_path / "scheduler/scheduler_config.json").write_text(json.dumps(config))
    with pytest.raises(ConfigError, match=sentence):
        load_goal_planner(tmp_path)
