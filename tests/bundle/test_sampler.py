"""Sampling of goal pictures and its noise equal those of diffusers and PyTorch."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from diffusers import AutoencoderKL, DDIMScheduler, DPMSolverMultistepScheduler, EulerDiscreteScheduler
from transformers import CLIPConfig, CLIPModel

from pentimento.bundle.sampler import Networks, NoiseSchedule, Prediction, complete, normal, seed_for
from pentimento.contracts.errors import ContractError
from pentimento.copainting.goal.planner import (
    GoalPlanner,
    GoalPlannerShape,
    SeededSampling,
    build_goal_planner,
    load_goal_planner,
    save_goal_planner,
    text_encoder_of,
)
from pentimento.copainting.goal.planner import (
    complete as complete_in_workshop,
)
from pentimento.copainting.jobs import generator_for
from pentimento.semantics.tokenizer import learn_tokenizer

LENGTH, SIDE = 12, 32
LATENT = SIDE // 2  # pixels
CAPTIONS = ["a cat", "a tree beside a house"]


def _planner(prediction: Prediction) -> GoalPlanner:
    torch.manual_seed(0)
    tokenizer = learn_tokenizer(CAPTIONS, 20, LENGTH)
    text = {
        "vocab_size": len(tokenizer), "hidden_size": 16, "intermediate_size": 32, "num_hidden_layers": 1,
        "num_attention_heads": 2, "max_position_embeddings": LENGTH, "eos_token_id": tokenizer.eos_token_id,
    }  # fmt: skip
    seen = {"hidden_size": 16, "intermediate_size": 32, "num_hidden_layers": 1, "num_attention_heads": 2,
            "image_size": SIDE, "patch_size": 16}  # fmt: skip
    vae = AutoencoderKL(
        down_block_types=("DownEncoderBlock2D",) * 2, up_block_types=("UpDecoderBlock2D",) * 2,
        block_out_channels=(8, 16), layers_per_block=1, latent_channels=4, norm_num_groups=4, sample_size=SIDE,
        scaling_factor=0.7,
    )  # fmt: skip
    encoder = text_encoder_of(CLIPModel(CLIPConfig(text_config=text, vision_config=seen)))
    shape = GoalPlannerShape((16, 32), 1, 2, prediction)
    planner = build_goal_planner(shape, vae.eval(), encoder.eval(), tokenizer=tokenizer, seed=0)
    planner.unet.eval()
    return planner


def _networks(planner: GoalPlanner) -> Networks:
    def plain(function: Any) -> Any:
        def call(*arrays: Any) -> Any:
            with torch.no_grad():
                return function(*(torch.from_numpy(a) if isinstance(a, np.ndarray) else a for a in arrays)).numpy()

        return call

    return Networks(
        read=plain(lambda tokens: planner.text_encoder(tokens)[0]),
        encode=plain(lambda picture: planner.vae.encode(picture).latent_dist.mode()),
        predict=plain(lambda latents, t, text: planner.unet(latents, t, encoder_hidden_states=text)[0]),
        decode=plain(lambda latents: planner.vae.decode(latents)[0]),
        scaling=planner.vae.config.scaling_factor,
    )


def _schedule(planner: GoalPlanner) -> NoiseSchedule:
    scheduler = planner.scheduler
    return NoiseSchedule(
        scheduler.alphas_cumprod.numpy(), float(scheduler.final_alpha_cumprod), scheduler.config.prediction_type,
        scheduler.config.timestep_spacing, scheduler.config.steps_offset,
    )  # fmt: skip


def _tokens(planner: GoalPlanner, captions: list[str]) -> np.ndarray:
    asked = planner.tokenizer(captions, padding="max_length", max_length=LENGTH, truncation=True)
    return np.array(asked["input_ids"])


def _canvases() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (len(CAPTIONS), SIDE, SIDE, 3), dtype=np.uint8)


@pytest.mark.parametrize("prediction", ["epsilon", "v_prediction", "sample"])
@pytest.mark.parametrize(("text_guidance", "steps"), [(4.0, 7), (1.0, 10)])
def test_complete_equals_the_diffusers_pipeline(prediction: Prediction, text_guidance: float, steps: int) -> None:
    planner, seed = _planner(prediction), 5
    sampling = SeededSampling(steps, 1.5, text_guidance, seed)
    theirs = complete_in_workshop(planner, _canvases(), CAPTIONS, sampling)
    latent = SIDE // planner.vae_scale_factor
    noise = np.concatenate([normal((1, 4, latent, latent), seed_for(seed, i)) for i in range(len(CAPTIONS))])
    ours = complete(
        _networks(planner), _schedule(planner), _canvases(), tokens=_tokens(planner, CAPTIONS),
        no_words=_tokens(planner, [""]), noise=noise, steps=steps, image_guidance=1.5, text_guidance=text_guidance,
    )  # fmt: skip
    difference = np.abs(ours.astype(int) - theirs.astype(int))
    assert difference.max() <= 1  # of 255: a value may be rounded either way
    assert np.linalg.norm(difference) <= 1e-3 * np.linalg.norm(theirs)


def _their_latents(planner: GoalPlanner, noise: np.ndarray, steps: int) -> np.ndarray:
    """Of diffusers' pipeline, whatever its sampler."""
    latents: torch.Tensor = planner(
        prompt=CAPTIONS, image=torch.from_numpy(_canvases()).permute(0, 3, 1, 2).float() / 255,
        num_inference_steps=steps, guidance_scale=3.0, image_guidance_scale=1.5, latents=torch.from_numpy(noise),
        output_type="latent",
    ).images  # fmt: skip
    return latents.numpy()


def _our_latents(planner: GoalPlanner, noise: np.ndarray, steps: int) -> np.ndarray:
    """Of the lean sampler."""
    found: list[np.ndarray] = []
    networks = _networks(planner)

    def decode(latents: np.ndarray) -> np.ndarray:
        found.append(latents * networks.scaling)
        return networks.decode(latents)

    complete(
        Networks(networks.read, networks.encode, networks.predict, decode, networks.scaling), _schedule(planner),
        _canvases(), tokens=_tokens(planner, CAPTIONS), no_words=_tokens(planner, [""]), noise=noise, steps=steps,
        image_guidance=1.5, text_guidance=3.0,
    )  # fmt: skip
    return found[0]


def _difference(ours: np.ndarray, theirs: np.ndarray) -> float:
    return float(np.linalg.norm(ours - theirs) / np.linalg.norm(theirs))


@pytest.mark.parametrize("prediction", ["epsilon", "v_prediction", "sample"])
def test_latents_equal_the_diffusers_pipeline(prediction: Prediction) -> None:
    planner = _planner(prediction)
    noise = normal((2, 4, LATENT, LATENT), 9)
    assert _difference(_our_latents(planner, noise, 8), _their_latents(planner, noise, 8)) <= 1e-5


PUBLISHED = {  # what Stable Diffusion 1.5 and Instruct-Pix2Pix say, without `clip_sample`
    "beta_start": 0.00085, "beta_end": 0.012, "beta_schedule": "scaled_linear", "num_train_timesteps": 1000,
    "steps_offset": 1,
}  # fmt: skip


@pytest.mark.parametrize(
    ("sampler", "spacing", "ends_at_one"),
    [
        ({"_class_name": "DDIMScheduler", "set_alpha_to_one": False}, "leading", False),
        ({"_class_name": "DDPMScheduler", "timestep_spacing": "trailing"}, "trailing", True),
        ({"_class_name": "PNDMScheduler", "skip_prk_steps": True}, "leading", False),
        ({"_class_name": "EulerDiscreteScheduler"}, "leading", True),
        ({"_class_name": "EulerAncestralDiscreteScheduler"}, "leading", True),
        ({"_class_name": "DPMSolverMultistepScheduler", "timestep_spacing": "trailing"}, "trailing", True),
        ({"_class_name": "DDIMScheduler", "rescale_betas_zero_snr": True, "prediction_type": "v_prediction"},
         "trailing", True),
    ],
)  # fmt: skip
def test_latents_equal_diffusers_ddim_for_the_schedule_of_each_published_sampler(
    tmp_path: Path, sampler: dict[str, Any], spacing: str, ends_at_one: bool
) -> None:
    """The folder names a sampler; the reference is diffusers' pipeline with DDIM of these betas, set up by hand."""
    prediction = sampler.get("prediction_type", "epsilon")
    save_goal_planner(_planner(prediction), tmp_path)
    (tmp_path / "scheduler/scheduler_config.json").write_text(json.dumps(PUBLISHED | sampler))
    planner = load_goal_planner(tmp_path)
    noise = 3 * normal((2, 4, LATENT, LATENT), 9)  # far outside of -1 to 1: clipping would show
    ours, loaded = _our_latents(planner, noise, 10), _their_latents(planner, noise, 10)
    planner.scheduler = DDIMScheduler(
        beta_start=0.00085, beta_end=0.012, beta_schedule="scaled_linear", clip_sample=False, steps_offset=1,
        prediction_type=prediction, timestep_spacing=spacing, set_alpha_to_one=ends_at_one,
        rescale_betas_zero_snr=sampler.get("rescale_betas_zero_snr", False),
    )  # fmt: skip
    theirs = _their_latents(planner, noise, 10)
    assert np.abs(theirs).max() > 1
    assert _difference(ours, theirs) <= 1e-5 and _difference(loaded, theirs) <= 1e-5


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of numpy, in Euler's sampler
def test_latents_equal_those_of_other_samplers_of_first_order(tmp_path: Path) -> None:
    """Without noise of their own, Euler's sampler and DPM-Solver++ of first order are DDIM in other coordinates."""
    save_goal_planner(_planner("epsilon"), tmp_path)
    noise = normal((2, 4, LATENT, LATENT), 9)
    betas = {key: value for key, value in PUBLISHED.items() if key != "num_train_timesteps"}
    samplers = (
        EulerDiscreteScheduler(**betas, timestep_spacing="leading"),
        DPMSolverMultistepScheduler(**betas, timestep_spacing="trailing", solver_order=1),
    )
    for sampler in samplers:
        sampler.save_pretrained(tmp_path / "scheduler")
        planner = load_goal_planner(tmp_path)
        ours = _our_latents(planner, noise, 10)
        planner.scheduler = sampler
        assert _difference(ours, _their_latents(planner, noise, 10)) <= 1e-5


@pytest.mark.parametrize("steps", [1, 3, 7, 20, 50])
def test_timesteps_equal_the_diffusers_scheduler(steps: int) -> None:
    for spacing, offset in (("trailing", 0), ("leading", 1)):
        theirs = DDIMScheduler(timestep_spacing=spacing, steps_offset=offset)
        theirs.set_timesteps(steps)
        ours = NoiseSchedule(theirs.alphas_cumprod.numpy(), 1.0, "epsilon", spacing, offset)  # type: ignore[arg-type]
        assert ours.timesteps(steps).tolist() == theirs.timesteps.tolist()


def test_noise_schedule_rejects_invalid_settings() -> None:
    falling = np.linspace(1, 0, 10, dtype=np.float32)
    with pytest.raises(ContractError, match="pure noise"):
        NoiseSchedule(falling, 1.0, "epsilon", "trailing")
    with pytest.raises(ContractError, match="linspace"):
        NoiseSchedule(falling, 1.0, "sample", "linspace")  # type: ignore[arg-type]
    with pytest.raises(ContractError, match="allows 1 to 10"):
        NoiseSchedule(falling, 1.0, "sample", "trailing").timesteps(11)


@pytest.mark.parametrize("shape", [(1, 8, 16, 16), (16,), (17,), (5, 7), (1, 4, 33, 9)])
@pytest.mark.parametrize("key", [(0, 0), (3, 4), (123456789, 2)])
def test_normal_equals_torch_randn(shape: tuple[int, ...], key: tuple[int, ...]) -> None:
    theirs = torch.randn(shape, generator=generator_for(*key)).numpy()
    np.testing.assert_allclose(normal(shape, seed_for(*key)), theirs, atol=3e-6)


def test_seed_depends_on_the_keys_length() -> None:
    assert not np.allclose(normal((64,), seed_for(1)), normal((64,), seed_for(1, 0)))


def test_normal_rejects_fewer_than_16_numbers() -> None:
    with pytest.raises(ContractError, match="16"):
        normal((3, 5), 0)
