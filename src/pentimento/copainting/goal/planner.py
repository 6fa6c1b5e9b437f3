"""The Supportive Goal Planner (thesis 6.4.2): an Instruct-Pix2Pix pipeline, small or as published.

It is diffusers' `StableDiffusionInstructPix2PixPipeline` throughout. The small one has the published architecture and
folder layout, so the same code loads, trains and samples both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np
import torch
from diffusers import AutoencoderKL, DDIMScheduler, StableDiffusionInstructPix2PixPipeline, UNet2DConditionModel
from huggingface_hub import snapshot_download
from numpy.typing import NDArray
from transformers import CLIPModel, CLIPTextModel, CLIPTokenizer

from pentimento.bundle.sampler import NoiseSchedule, Prediction
from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.ranges import at_least
from pentimento.copainting.goal.published import check_parts, check_pipeline, ddim_of, merge_adapter, widen
from pentimento.copainting.jobs import generator_for
from pentimento.semantics.devices import chosen_device, in_batches
from pentimento.semantics.pretrained import load_pretrained, load_tokenizer, unreadable

GoalPlanner: TypeAlias = StableDiffusionInstructPix2PixPipeline

_TRAIN_TIMESTEPS: Final = 1000  # as in Stable Diffusion
_GROUPS: Final = 8  # of channels, in the group normalisation of a small UNet
_ATTENDING: Final = 2  # of a small UNet's resolutions, the coarsest: they attend to the text
_CHUNK: Final = 16  # pictures in one call of the pipeline


@dataclass(frozen=True)
class GoalPlannerShape:
    """The UNet of a small goal planner."""

    unet_channels: tuple[int, ...]
    """Of each resolution, the finest first; the two coarsest attend to the text."""
    unet_layers: int
    """Residual blocks at each resolution."""
    heads: int
    """Of the attention to the text and within the picture."""
    prediction: Prediction
    """What the UNet predicts: the noise, the velocity or the clean latents. For the last two, the noise schedule ends
    in pure noise (zero terminal SNR, Lin et al. 2023); a prediction of the noise would then carry no information.
    """

    def __post_init__(self) -> None:
        at_least(self, 1, "unet_layers", "heads")
        for width in self.unet_channels:
            if width % _GROUPS:
                raise ValueError(f"unet_channels has {width}; groups of {_GROUPS} are normalised, so take a multiple.")


@dataclass(frozen=True)
class GoalSampling:
    """How goal pictures are sampled, with the guidances of Instruct-Pix2Pix (Brooks et al. 2023, eq. 3)."""

    steps: int
    """Of DDIM."""
    image_guidance: float
    text_guidance: float
    """1 switches both guidances off: the network is evaluated once per step, not three times, as published."""

    def __post_init__(self) -> None:
        at_least(self, 1, "steps", "image_guidance", "text_guidance")


@dataclass(frozen=True)
class SeededSampling(GoalSampling):
    """The same with the seed of the initial noise."""

    seed: int

    def __post_init__(self) -> None:
        super().__post_init__()
        at_least(self, 0, "seed")


def text_encoder_of(model: CLIPModel) -> CLIPTextModel:
    """A copy of the text tower of a text-image encoder, as the text encoder of a Stable Diffusion pipeline."""
    text_encoder = CLIPTextModel(model.config.text_config)
    names = text_encoder.state_dict()
    tower = {name.removeprefix("text_model."): weight for name, weight in model.text_model.state_dict().items()}
    text_encoder.load_state_dict({name: tower[name.removeprefix("text_model.")] for name in names})
    return text_encoder


def build_goal_planner(
    shape: GoalPlannerShape, vae: AutoencoderKL, text_encoder: CLIPTextModel, *, tokenizer: CLIPTokenizer, seed: int
) -> GoalPlanner:
    """A small goal planner with a new UNet, around a trained autoencoder and text encoder."""
    torch.manual_seed(seed)
    attending = min(_ATTENDING, len(shape.unet_channels))
    plain = len(shape.unet_channels) - attending
    unet = UNet2DConditionModel(
        sample_size=vae.config.sample_size // 2 ** (len(vae.config.block_out_channels) - 1),
        in_channels=2 * vae.config.latent_channels,
        out_channels=vae.config.latent_channels,
        down_block_types=("DownBlock2D",) * plain + ("CrossAttnDownBlock2D",) * attending,
        up_block_types=("CrossAttnUpBlock2D",) * attending + ("UpBlock2D",) * plain,
        block_out_channels=shape.unet_channels,
        layers_per_block=shape.unet_layers,
        cross_attention_dim=text_encoder.config.hidden_size,
        attention_head_dim=shape.heads,  # diffusers' name for their number, kept for the published folders
        norm_num_groups=_GROUPS,
        addition_embed_type="text",  # the words reach every block with the time, not those alone that attend to them
        addition_embed_type_num_heads=shape.heads,
        resnet_time_scale_shift="scale_shift",  # and scale its channels (Dhariwal and Nichol 2021, section 4.3)
    )
    scheduler = DDIMScheduler(
        num_train_timesteps=_TRAIN_TIMESTEPS,
        beta_start=0.00085,
        beta_end=0.012,
        beta_schedule="scaled_linear",
        clip_sample=False,
        prediction_type=shape.prediction,
        rescale_betas_zero_snr=shape.prediction != "epsilon",
        timestep_spacing="trailing",
    )
    return _pipeline(vae, text_encoder, tokenizer=tokenizer, unet=unet, scheduler=scheduler)


def load_goal_planner(source: str | Path) -> GoalPlanner:
    """A goal planner from a folder in diffusers' layout, or a published one by name, if it was downloaded before.

    Nothing is downloaded, and only safetensors are read, whole, in shards, or of the variant fp16. The scheduler is
    replaced by DDIM with the same noise schedule, whose sampling is deterministic after the initial noise; it never
    clips. The UNet of a text-to-image base is widened, and an adapter in the folder is merged (`goal.published`).

    Raises:
        ConfigError: nothing there, an incomplete folder, another pipeline, or parts that do not fit together.
    """
    try:
        with unreadable("It"):
            folder = Path(source)
            if not folder.is_dir():
                folder = Path(snapshot_download(str(source), local_files_only=True))
            check_pipeline(folder)
        text_encoder, vae, unet = (
            load_pretrained(kind, folder, "The weights", subfolder=part)
            for part, kind in (
                ("text_encoder", CLIPTextModel),
                ("vae", AutoencoderKL),
                ("unet", UNet2DConditionModel),
            )
        )
        words = text_encoder.config.vocab_size
        tokenizer = load_tokenizer(folder, "The tokenizer", words, subfolder="tokenizer")
        with unreadable("It"):
            widen(unet, vae.config.latent_channels)
            planner = _pipeline(vae, text_encoder, tokenizer=tokenizer, unet=unet, scheduler=ddim_of(folder))
            merge_adapter(planner, folder)
    except ConfigError as error:
        reason = str(error).rstrip(".")
        raise ConfigError(
            f"The goal planner {source} cannot be loaded as an Instruct-Pix2Pix pipeline ({reason}); give a "
            "folder in diffusers' layout, or download the published one first."
        ) from error
    check_parts(planner, source)
    return planner


def save_goal_planner(planner: GoalPlanner, folder: Path) -> None:
    """Write the pipeline in diffusers' layout, complete for `load_goal_planner`.

    The folders that its parts were loaded from are not written: they may be scratch folders.
    """
    for part in (planner, planner.unet, planner.vae):
        part.register_to_config(_name_or_path="")
    planner.save_pretrained(folder, safe_serialization=True)
    planner.tokenizer.backend_tokenizer.model.save(str(Path(folder) / "tokenizer"))  # vocab.json and merges.txt, too


def picture_step_px(planner: GoalPlanner) -> int:
    """The sides of pictures must be a multiple of this: the autoencoder and the UNet halve them so often."""
    return int(planner.vae_scale_factor * 2 ** (len(planner.unet.config.block_out_channels) - 1))


def check_pictures(planner: GoalPlanner, pictures: NDArray[np.uint8]) -> None:
    """Raise `ContractError` unless pictures are uint8 [B, H, W, 3] with sides that the planner can halve."""
    step = picture_step_px(planner)
    shape = pictures.shape
    if pictures.dtype != np.uint8 or pictures.ndim != 4 or shape[-1] != 3 or shape[1] % step or shape[2] % step:
        raise ContractError(
            f"The goal planner was given {pictures.dtype} {list(shape)}; it needs uint8 [B, H, W, 3] with H and W "
            f"multiples of {step}: resize the pictures."
        )


def check_steps(scheduler: DDIMScheduler, steps: int) -> None:
    """Raise `ContractError` where a noise schedule has not that many steps of sampling."""
    config = scheduler.config
    NoiseSchedule(
        scheduler.alphas_cumprod.numpy(), float(scheduler.final_alpha_cumprod), config.prediction_type,
        config.timestep_spacing, config.steps_offset,
    ).timesteps(steps)  # fmt: skip


@torch.no_grad()
def complete(
    planner: GoalPlanner,
    inputs: NDArray[np.uint8],
    captions: Sequence[str],
    sampling: SeededSampling,
) -> NDArray[np.uint8]:
    """Goal pictures, uint8 [B, H, W, 3], for canvases, uint8 [B, H, W, 3], and prompts; item i starts from noise of
    (seed, i). The planner moves to the chosen device.

    Raises:
        ContractError: pictures of another type or size than the planner takes, another number of captions, or more
            steps than the noise schedule has.
    """
    check_pictures(planner, inputs)
    if len(captions) != len(inputs):
        raise ContractError(f"{len(inputs)} pictures came with {len(captions)} captions; give one for each.")
    check_steps(planner.scheduler, sampling.steps)
    planner.to(chosen_device())
    planner.unet.eval()

    def completed(part: slice) -> NDArray[np.uint8]:
        shown = torch.from_numpy(np.ascontiguousarray(inputs[part])).permute(0, 3, 1, 2).float() / 255
        images = planner(
            prompt=[*captions[part]],
            image=shown,
            num_inference_steps=sampling.steps,
            guidance_scale=sampling.text_guidance,
            image_guidance_scale=sampling.image_guidance,
            generator=[generator_for(sampling.seed, index) for index in range(part.start, part.stop)],
            output_type="np",
        ).images
        return np.round(images * 255).astype(np.uint8)

    return np.concatenate(in_batches(completed, len(inputs), _CHUNK)) if len(inputs) else inputs.copy()


def _pipeline(
    vae: AutoencoderKL,
    text_encoder: CLIPTextModel,
    *,
    tokenizer: CLIPTokenizer,
    unet: UNet2DConditionModel,
    scheduler: DDIMScheduler,
) -> GoalPlanner:
    planner = GoalPlanner(
        vae=vae,
        text_encoder=text_encoder,
        tokenizer=tokenizer,
        unet=unet,
        scheduler=scheduler,
        safety_checker=None,
        feature_extractor=None,
        image_encoder=None,
        requires_safety_checker=False,
    )
    planner.set_progress_bar_config(disable=True)
    return planner
