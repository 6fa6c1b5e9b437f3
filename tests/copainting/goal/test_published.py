"""Folders of the published family: variants, shards, pickles, text-to-image bases, adapters and samplers."""

import json
import shlex
from pathlib import Path
from typing import Any

import pytest
import torch
from diffusers import AutoencoderKL, UNet2DConditionModel
from peft.utils import get_peft_model_state_dict
from safetensors.torch import load_file, save_file

from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.copainting.goal.denoising import Lora
from pentimento.copainting.goal.planner import (
    GoalPlanner,
    SeededSampling,
    complete,
    load_goal_planner,
    save_goal_planner,
)
from pentimento.copainting.goal.published import ADAPTER
from pentimento.copainting.goal.training import _add_lora
from tests.copainting.goal_planners import CAPTIONS, small_pairs, small_planner

PARTS = ("unet", "vae", "text_encoder")
BETAS = {"beta_start": 0.00085, "beta_end": 0.012, "beta_schedule": "scaled_linear"}


@pytest.fixture
def planner() -> GoalPlanner:
    return small_planner()


def weights(planner: GoalPlanner) -> list[torch.Tensor]:
    return [weight for part in PARTS for weight in getattr(planner, part).state_dict().values()]


def with_sampler(folder: Path, **config: Any) -> GoalPlanner:
    (folder / "scheduler/scheduler_config.json").write_text(json.dumps(BETAS | config))
    return load_goal_planner(folder)


@pytest.mark.parametrize("shards", [False, True])
@pytest.mark.parametrize("variant", [None, "fp16"])
def test_variants_and_shards_are_loaded(
    planner: GoalPlanner, tmp_path: Path, variant: str | None, shards: bool
) -> None:
    save_goal_planner(planner, tmp_path)
    size = {"unet": "50KB", "vae": "20KB", "text_encoder": "10KB"}
    for name in PARTS:
        for file in (tmp_path / name).glob("*.safetensors"):
            file.unlink()
        limit = {"max_shard_size": size[name]} if shards else {}
        getattr(planner, name).save_pretrained(tmp_path / name, variant=variant, **limit)
    loaded = load_goal_planner(tmp_path)
    assert all(torch.equal(one, other) for one, other in zip(weights(planner), weights(loaded), strict=True))
    if shards:
        next((tmp_path / "unet").glob("*00002-of*")).write_bytes(b"cut")
        with pytest.raises(ConfigError, match=r"00002-of-\d+.safetensors is cut off or damaged"):
            load_goal_planner(tmp_path)


def test_whole_weights_are_taken_where_a_folder_has_a_variant_of_them_too(planner: GoalPlanner, tmp_path: Path) -> None:
    save_goal_planner(planner, tmp_path)
    other = small_planner(1)
    other.unet.save_pretrained(tmp_path / "unet", variant="fp16")
    assert torch.equal(load_goal_planner(tmp_path).unet.conv_in.weight, planner.unet.conv_in.weight)


def test_a_folder_of_pickles_is_refused_with_the_command_that_converts_it(planner: GoalPlanner, tmp_path: Path) -> None:
    save_goal_planner(planner, tmp_path)
    for name, pickled in (("unet", "diffusion_pytorch_model.bin"), ("text_encoder", "pytorch_model.bin")):
        (file,) = (tmp_path / name).glob("*.safetensors")
        torch.save(load_file(file), tmp_path / name / pickled)
        file.unlink()
    for name in ("text_encoder", "unet"):
        with pytest.raises(ConfigError, match=f"{name} cannot be read: its weights are pickled") as refused:
            load_goal_planner(tmp_path)
        command = str(refused.value).partition("convert them: ")[2].rpartition("); give a folder")[0]
        python, flag, code = shlex.split(command)
        assert (python, flag) == ("python", "-c")
        exec(code, {})
    assert all(torch.equal(*pair) for pair in zip(weights(planner), weights(load_goal_planner(tmp_path)), strict=True))


def text_to_image(planner: GoalPlanner, folder: Path, channels: int = 4) -> UNet2DConditionModel:
    """Write a base whose UNet takes this number of channels, as Stable Diffusion's."""
    save_goal_planner(planner, folder)
    unet = UNet2DConditionModel.from_config(dict(planner.unet.config) | {"in_channels": channels})
    unet.save_pretrained(folder / "unet")
    index = json.loads((folder / "model_index.json").read_text())
    (folder / "model_index.json").write_text(json.dumps(index | {"_class_name": "StableDiffusionPipeline"}))
    return unet.eval()


def test_a_text_to_image_base_predicts_as_before_whatever_the_picture(planner: GoalPlanner, tmp_path: Path) -> None:
    before = text_to_image(planner, tmp_path / "base")
    loaded = load_goal_planner(tmp_path / "base")
    assert loaded.unet.config.in_channels == 8
    noisy, picture, text = torch.randn(2, 4, 8, 8), 9 * torch.randn(2, 4, 8, 8), torch.randn(2, 12, 16)
    with torch.no_grad():
        after = loaded.unet(torch.cat([noisy, picture], 1), 500, text).sample
        assert torch.allclose(after, before(noisy, 500, text).sample, atol=1e-6)
    # The picture's weights learn: their gradient is not zero.
    loaded.unet.requires_grad_(True)
    loaded.unet(torch.cat([noisy, picture], 1), 500, text).sample.square().mean().backward()
    assert loaded.unet.conv_in.weight.grad[:, 4:].abs().min() > 0
    # It is saved and loaded as Instruct-Pix2Pix from then on.
    save_goal_planner(loaded, tmp_path / "wide")
    index = json.loads((tmp_path / "wide/model_index.json").read_text())
    assert index["_class_name"] == "StableDiffusionInstructPix2PixPipeline"
    assert torch.equal(load_goal_planner(tmp_path / "wide").unet.conv_in.weight, loaded.unet.conv_in.weight)


@pytest.mark.parametrize("channels", [5, 9])
def test_a_base_of_other_channels_is_refused(planner: GoalPlanner, tmp_path: Path, channels: int) -> None:
    text_to_image(planner, tmp_path, channels)
    with pytest.raises(ConfigError, match=f"takes {channels} channels, but Instruct-Pix2Pix needs 8"):
        load_goal_planner(tmp_path)


def test_an_adapter_in_the_folder_is_merged(planner: GoalPlanner, tmp_path: Path) -> None:
    save_goal_planner(planner, tmp_path / "base")
    rank = 2
    _add_lora(planner, Lora(rank, rank))
    for name, weight in planner.unet.named_parameters():
        if "lora_" in name:
            torch.nn.init.normal_(weight, std=0.1)
    planner.save_lora_weights(tmp_path / "base", unet_lora_layers=get_peft_model_state_dict(planner.unet))
    before = load_file(tmp_path / "base/unet/diffusion_pytorch_model.safetensors")["conv_in.weight"]
    loaded = load_goal_planner(tmp_path / "base").unet
    planner.unet.fuse_lora()
    planner.unet.unload_lora()
    merged = planner.unet.state_dict()
    assert merged.keys() == loaded.state_dict().keys()
    assert all(torch.allclose(weight, merged[name], atol=1e-6) for name, weight in loaded.state_dict().items())
    assert not torch.allclose(loaded.conv_in.weight, before, atol=0.01)
    updates = load_file(tmp_path / "base" / ADAPTER)
    strange = {name.replace("unet.conv_in", "unet.conv_other"): value for name, value in updates.items()}
    save_file(strange, tmp_path / "base" / ADAPTER)
    with pytest.raises(ConfigError, match=r"of which .* are in this base|conv_other"):
        load_goal_planner(tmp_path / "base")


@pytest.mark.parametrize(
    ("part", "change", "sentence"),
    [
        ("unet", {"time_cond_proj_dim": 8}, "time_cond_proj_dim"),
        ("unet", {"num_class_embeds": 3}, "num_class_embeds"),
        ("unet", {"out_channels": 8}, "gives 8 channels, not 4"),
        ("vae", {"shift_factor": 0.1}, "shifts its latents"),
    ],
)
def test_parts_of_another_family_are_refused(
    planner: GoalPlanner, tmp_path: Path, part: str, change: dict[str, Any], sentence: str
) -> None:
    save_goal_planner(planner, tmp_path)
    model = getattr(planner, part)
    config = {name: value for name, value in model.config.items() if name != "_use_default_values"}
    type(model).from_config(config | change).save_pretrained(tmp_path / part)
    with pytest.raises(ConfigError, match=sentence):
        load_goal_planner(tmp_path)


def test_another_pipeline_is_refused_by_name(planner: GoalPlanner, tmp_path: Path) -> None:
    save_goal_planner(planner, tmp_path)
    (tmp_path / "model_index.json").write_text(json.dumps({"_class_name": "StableDiffusionXLInstructPix2PixPipeline"}))
    with pytest.raises(ConfigError, match="names the pipeline StableDiffusionXLInstructPix2PixPipeline, not one of"):
        load_goal_planner(tmp_path)


def test_an_old_autoencoder_has_stable_diffusions_scaling(planner: GoalPlanner, tmp_path: Path) -> None:
    """Folders of that time leave `scaling_factor` and `force_upcast` out; others keep theirs."""
    save_goal_planner(planner, tmp_path)
    file = tmp_path / "vae/config.json"
    config = json.loads(file.read_text())
    AutoencoderKL.from_config(config | {"scaling_factor": 0.13}).save_pretrained(tmp_path / "vae")
    assert load_goal_planner(tmp_path).vae.config.scaling_factor == 0.13
    file.write_text(json.dumps({key: v for key, v in config.items() if key not in ("scaling_factor", "force_upcast")}))
    loaded = load_goal_planner(tmp_path).vae.config
    assert (loaded.scaling_factor, loaded.force_upcast) == (0.18215, True)


def test_what_a_sampler_leaves_out_is_its_own_default(planner: GoalPlanner, tmp_path: Path) -> None:
    """PNDM ends at the first share of variance, DDIM and Euler at 1; betas that are not named are the sampler's."""
    save_goal_planner(planner, tmp_path)
    ends = {}
    for name in ("PNDMScheduler", "DDIMScheduler", "DDPMScheduler", "EulerDiscreteScheduler"):
        scheduler = with_sampler(tmp_path, _class_name=name).scheduler
        ends[name] = float(scheduler.final_alpha_cumprod)
    first = float(scheduler.alphas_cumprod[0])
    assert ends == {
        "PNDMScheduler": first, "DDIMScheduler": 1.0, "DDPMScheduler": 1.0, "EulerDiscreteScheduler": 1.0,
    }  # fmt: skip
    last = with_sampler(tmp_path, _class_name="DPMSolverMultistepScheduler", final_sigmas_type="sigma_min")
    assert float(last.scheduler.final_alpha_cumprod) == first
    (tmp_path / "scheduler/scheduler_config.json").write_text(json.dumps({"_class_name": "HeunDiscreteScheduler"}))
    betas = load_goal_planner(tmp_path).scheduler.betas
    assert (float(betas[0]), float(betas[-1])) == pytest.approx((0.00085, 0.012))


@pytest.mark.parametrize(
    ("config", "sentence"),
    [
        ({"_class_name": "CogVideoXDDIMScheduler"}, "changes its noise schedule"),
        (
            {"_class_name": "EulerDiscreteScheduler", "timestep_type": "continuous", "prediction_type": "v_prediction"},
            "continuous timesteps",
        ),
        ({"_class_name": "DDIMScheduler", "rescale_betas_zero_snr": True}, "ends in pure noise"),
        ({"_class_name": "SomebodysScheduler"}, "SomebodysScheduler is none of diffusers"),
        ({}, "sampler None is none"),
    ],
)
def test_a_sampler_that_ddim_cannot_replace_is_refused(
    planner: GoalPlanner, tmp_path: Path, config: dict[str, Any], sentence: str
) -> None:
    save_goal_planner(planner, tmp_path)
    with pytest.raises(ConfigError, match=sentence):
        with_sampler(tmp_path, **config)


def test_steps_beyond_the_schedule_are_refused(planner: GoalPlanner, tmp_path: Path) -> None:
    save_goal_planner(planner, tmp_path)
    loaded = with_sampler(tmp_path, _class_name="PNDMScheduler", steps_offset=1)
    pictures, ask = small_pairs(1)[0].input[None], list(CAPTIONS[:1])
    refusals: tuple[tuple[int, str], ...] = ((1001, "allows 1 to 1000"), (1000, "beyond the last timestep, 999"))
    for steps, sentence in refusals:
        with pytest.raises(ContractError, match=sentence):
            complete(loaded, pictures, ask, SeededSampling(steps, 1.0, 1.0, 0))
