"""What published folders of the Instruct-Pix2Pix family leave open: sampler, first convolution, adapters, variants.

Each is brought into the one form that the planner trains, samples and deploys: DDIM, a UNet of 2C input channels, and
weights with their adapters merged. What has no such form is refused with the reason.
"""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any, Final, get_args

import diffusers
import torch
from diffusers import DDIMScheduler, StableDiffusionInstructPix2PixPipeline, UNet2DConditionModel
from peft.tuners.tuners_utils import BaseTunerLayer

from pentimento.bundle.sampler import Prediction
from pentimento.contracts.errors import ConfigError
from pentimento.semantics.pretrained import check_file

ADAPTER: Final = "pytorch_lora_weights.safetensors"
"""Low-rank updates beside a base, as `save_lora_weights` of diffusers names them."""
_PIPELINES: Final = ("StableDiffusionInstructPix2PixPipeline", "StableDiffusionPipeline")
_DISTILLED: Final = ("LCMScheduler", "TCDScheduler")
_PREDICTIONS: Final = ", ".join(get_args(Prediction))
_SCHEDULE: Final = (
    "num_train_timesteps", "beta_start", "beta_end", "beta_schedule", "trained_betas", "rescale_betas_zero_snr",
    "steps_offset",
)  # fmt: skip
_CLOSE: Final = 1e-6  # of shares of variance; some samplers end a zero terminal SNR at 2^-24 instead of 0


def check_pipeline(folder: Path) -> None:
    """Raise ConfigError unless the folder's index names Instruct-Pix2Pix or the Stable Diffusion that it came from."""
    index = folder / "model_index.json"
    check_file(index)
    name = json.loads(index.read_text(encoding="utf-8")).get("_class_name")
    if name not in _PIPELINES:
        raise ConfigError(f"its model_index.json names the pipeline {name}, not one of {', '.join(_PIPELINES)}")


def ddim_of(folder: Path) -> DDIMScheduler:
    """DDIM for the noise schedule of the sampler in `scheduler/scheduler_config.json`; it never clips.

    What the file leaves out is the default of the sampler that it names, which is not always DDIM's: PNDM ends at the
    first share of variance, not at 1. Steps are trailing or leading as the file says. Other spacings, and none, become
    leading, as published, or trailing for a schedule that ends in pure noise: DDIM's steps are of one length, and those
    of `linspace` do not meet them.

    Raises:
        ConfigError: DDIM cannot sample what this sampler does.
    """
    check_file(folder / "scheduler" / "scheduler_config.json")
    config = DDIMScheduler.load_config(folder, subfolder="scheduler", local_files_only=True)
    name = str(config.get("_class_name"))
    if name in _DISTILLED:
        raise ConfigError(f"its sampler {name} is of a distilled model, which DDIM does not sample")
    prediction = config.get("prediction_type", "epsilon")
    if prediction not in get_args(Prediction):
        raise ConfigError(f"its sampler {name} has the prediction type {prediction!r}, not one of {_PREDICTIONS}")
    kind = getattr(diffusers, name, None)
    if kind is None:
        raise ConfigError(f"its sampler {name} is none of diffusers {diffusers.__version__}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of numpy, at some of diffusers' samplers
        theirs = kind.from_config(config)
    given = theirs.config
    if not hasattr(theirs, "alphas_cumprod") or "beta_start" not in given:
        raise ConfigError(f"its sampler {name} has no noise schedule (beta_start, beta_end, beta_schedule)")
    if given.get("timestep_type", "discrete") != "discrete":
        raise ConfigError(
            f"its sampler {name} has {given['timestep_type']} timesteps, which DDIM's networks do not take"
        )
    spacing = config.get("timestep_spacing")
    if spacing not in ("leading", "trailing"):
        spacing = "trailing" if given.get("rescale_betas_zero_snr") else "leading"
    ours = DDIMScheduler(
        **{key: given[key] for key in _SCHEDULE if key in given},
        clip_sample=False,
        thresholding=False,
        prediction_type=prediction,
        timestep_spacing=spacing,
        set_alpha_to_one=given.get("set_alpha_to_one", given.get("final_sigmas_type", "zero") == "zero"),
    )
    if not torch.allclose(ours.alphas_cumprod, theirs.alphas_cumprod.float(), rtol=0, atol=_CLOSE):
        raise ConfigError(f"its sampler {name} changes its noise schedule in a way that DDIM does not know")
    if prediction == "epsilon" and ours.alphas_cumprod[-1] == 0:
        raise ConfigError(
            f"its sampler {name} ends in pure noise (rescale_betas_zero_snr), in which a prediction of the noise says "
            "nothing of the picture; such a model predicts v_prediction or sample"
        )
    return ours


def widen(unet: UNet2DConditionModel, channels: int) -> None:
    """Let a text-to-image UNet take the latents of an input picture, too: in place, by zeros in its first convolution.

    It then predicts what it did before, whatever the picture, until it is trained (Brooks et al. 2023, section 3.2). A
    UNet of another number of channels than `channels` of a picture's latents is left as it is.
    """
    before = unet.conv_in
    if unet.config.in_channels != channels:
        return
    after = torch.nn.Conv2d(2 * channels, before.out_channels, before.kernel_size, padding=before.padding)
    with torch.no_grad():
        after.weight.zero_()
        after.weight[:, :channels] = before.weight
        after.bias = before.bias
    unet.conv_in = after
    unet.register_to_config(in_channels=2 * channels)


def merge_adapter(planner: StableDiffusionInstructPix2PixPipeline, folder: Path) -> None:
    """Add the low-rank updates of `pytorch_lora_weights.safetensors` to the weights, if the folder has this file.

    Raises:
        ConfigError: updates of weights that the planner has not.
    """
    if not (folder / ADAPTER).exists():
        return
    check_file(folder / ADAPTER)
    updates, _ = planner.lora_state_dict(folder, weight_name=ADAPTER, local_files_only=True)
    told = {key.rpartition(".lora")[0] for key in updates if ".lora" in key}
    planner.load_lora_weights(folder, weight_name=ADAPTER, local_files_only=True)
    parts = (planner.unet, planner.text_encoder)
    found = sum(isinstance(module, BaseTunerLayer) for part in parts for module in part.modules())
    if found != len(told):
        raise ConfigError(f"{ADAPTER} updates {len(told)} layers, of which {found} are in this base; it is for another")
    planner.fuse_lora()
    planner.unload_lora_weights()


def check_parts(planner: StableDiffusionInstructPix2PixPipeline, source: str | Path) -> None:
    """Raise ConfigError unless the parts fit together and the sampler gives them all that they take."""
    unet, vae = planner.unet.config, planner.vae.config
    latents, width = vae.latent_channels, planner.text_encoder.config.hidden_size
    if unet.in_channels != 2 * latents:
        raise ConfigError(
            f"The UNet of {source} takes {unet.in_channels} channels, but Instruct-Pix2Pix needs {2 * latents} (the "
            "noisy latents and those of the input picture): it is another architecture; give an Instruct-Pix2Pix base, "
            f"or a text-to-image base of {latents} channels."
        )
    if unet.out_channels != latents:
        raise ConfigError(
            f"The UNet of {source} gives {unet.out_channels} channels, not {latents}: it predicts variances, too, "
            f"which DDIM does not sample; give a base whose UNet predicts {_PREDICTIONS} and nothing else."
        )
    if unet.cross_attention_dim != width:
        raise ConfigError(
            f"The UNet of {source} attends to {unet.cross_attention_dim} text channels, but its text encoder has "
            f"{width}: the parts come from different models; give a folder saved as one."
        )
    further = {
        "addition_embed_type": unet.addition_embed_type not in (None, "text"),
        "class_embed_type": unet.class_embed_type is not None,
        "num_class_embeds": unet.num_class_embeds is not None,
        "encoder_hid_dim_type": unet.encoder_hid_dim_type is not None,
        "time_cond_proj_dim": unet.time_cond_proj_dim is not None,
    }
    if asked := [name for name, is_asked in further.items() if is_asked]:
        raise ConfigError(
            f"The UNet of {source} takes more than latents, time and text ({', '.join(asked)}), which Instruct-Pix2Pix "
            "does not give: it is of another family or distilled; give an Instruct-Pix2Pix base."
        )
    shifts = (_of(vae, name) for name in ("shift_factor", "latents_mean", "latents_std"))
    if any(shift is not None for shift in shifts):
        raise ConfigError(
            f"The autoencoder of {source} shifts its latents (shift_factor, latents_mean), which Instruct-Pix2Pix does "
            "not: it is of another family; give an Instruct-Pix2Pix base."
        )


def _of(config: Any, name: str) -> Any:
    value = config.get(name)
    return None if value in (0, 0.0) else value
