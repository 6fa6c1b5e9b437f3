"""The parts of the goal planner as graphs, with the facts for `bundle.sampler`."""

from __future__ import annotations

import copy
from typing import Any, Final

import torch
from diffusers import DDIMScheduler
from torch import Tensor, nn

from pentimento.bundle.manifest import GoalFacts, WordsFacts
from pentimento.contracts.errors import ConfigError
from pentimento.copainting.goal.planner import GoalPlanner, GoalSampling
from pentimento.deploy.graphs import Graph, compared, export_module, generator

_UNITS: Final = {
    "tokens": "token ids, padded with the end token",
    "states": "hidden states of the text encoder",
    "pictures": "sRGB from -1 to 1, [B, 3, H, W]",
    "latents": "latents; of goal_decode divided by their scaling",
    "noisy": "noisy latents, then those of the canvas",
    "timestep": "of the noise schedule",
    "told": "prediction of the network, see the facts",
}
_BATCHES: Final = (1, 3)  # guidance evaluates three at once; at 512 px, six need more than 20 GB


def goal_graphs(planner: GoalPlanner, tolerance: float, half_tolerance: float | None) -> dict[str, Graph]:
    """`goal_text`, `goal_encode`, `goal_denoise` and `goal_decode`, each with a dynamic number of pictures.

    Inputs and outputs are in single precision. With a `half_tolerance`, weights and computation are in half precision,
    but for an autoencoder whose config says `force_upcast`: half precision overflows in it.

    Raises:
        ParityError: a graph does not compute what PyTorch does.
    """
    side, channels = _side_px(planner), planner.vae.config.latent_channels
    small = side // planner.vae_scale_factor
    length, width = planner.tokenizer.model_max_length, planner.text_encoder.config.hidden_size
    planner.text_encoder.set_attn_implementation("eager")

    def examples(name: str, batch: int) -> list[Tensor]:
        numbers = generator(name, batch)
        match name:
            case "goal_text":
                tokens = torch.randint(0, planner.tokenizer.eos_token_id, (batch, length), generator=numbers)
                tokens[:, length // 2 :] = planner.tokenizer.eos_token_id
                return [tokens]
            case "goal_encode":
                return [2 * torch.rand(batch, 3, side, side, generator=numbers) - 1]
            case "goal_decode":
                return [torch.randn(batch, channels, small, small, generator=numbers)]
        noisy = torch.randn(batch, 2 * channels, small, small, generator=numbers)
        timestep = torch.randint(0, planner.scheduler.config.num_train_timesteps, (1,), generator=numbers)
        return [noisy, timestep, torch.randn(batch, length, width, generator=numbers)]

    of_vae = None if planner.vae.config.force_upcast else half_tolerance
    parts: tuple[tuple[str, nn.Module, list[str], str, float | None], ...] = (
        ("goal_text", _Read(planner.text_encoder), ["tokens"], "states", half_tolerance),
        ("goal_encode", _Encode(planner.vae), ["pictures"], "latents", of_vae),
        ("goal_denoise", _Denoise(planner.unet), ["noisy", "timestep", "states"], "told", half_tolerance),
        ("goal_decode", _Decode(planner.vae), ["latents"], "pictures", of_vae),
    )
    graphs = {}
    for name, part, inputs, output, of_half in parts:
        part.eval().requires_grad_(False)
        free = [dict[int, str]() if key == "timestep" else {0: "pictures_at_once"} for key in inputs]
        exported = export_module(
            part if of_half is None else copy.deepcopy(part).half(), examples(name, 2), inputs, outputs=[output],
            free=free,
        )  # fmt: skip
        graphs[name] = compared(
            name, exported, _as_function(part), examples=[examples(name, batch) for batch in _BATCHES], units=_UNITS,
            tolerance=tolerance if of_half is None else of_half, models=("goal",),
        )  # fmt: skip
    return graphs


def goal_facts(planner: GoalPlanner, words: WordsFacts, sampling: GoalSampling, *, nouns: str | None) -> GoalFacts:
    """The facts of a goal planner for the sampler; `nouns` is the file of its vocabulary.

    Raises:
        ConfigError: the lean core's sampler does not support its noise schedule.
    """
    scheduler = planner.scheduler
    config = scheduler.config
    known = isinstance(scheduler, DDIMScheduler) and not config.thresholding and not config.clip_sample
    if not known or config.timestep_spacing not in ("trailing", "leading"):
        raise ConfigError(
            f"The goal planner's noise schedule ({type(scheduler).__name__}, {config.timestep_spacing}) is none that "
            "the runner samples: use DDIM with trailing or leading steps, without thresholding or clipping."
        )
    return GoalFacts(
        side_px=_side_px(planner),
        latent_channels=planner.vae.config.latent_channels,
        latent_step_px=planner.vae_scale_factor,
        scaling=planner.vae.config.scaling_factor,
        alphas_cumprod=tuple(scheduler.alphas_cumprod.tolist()),
        final_alpha=float(scheduler.final_alpha_cumprod),
        prediction=config.prediction_type,
        spacing=config.timestep_spacing,
        offset=config.steps_offset,
        steps=sampling.steps,
        image_guidance=sampling.image_guidance,
        text_guidance=sampling.text_guidance,
        words=words,
        nouns=nouns,
    )


def _side_px(planner: GoalPlanner) -> int:
    return int(planner.unet.config.sample_size * planner.vae_scale_factor)


def _as_function(part: nn.Module) -> Any:
    def function(*arguments: Tensor) -> tuple[Tensor]:
        with torch.no_grad():
            return (part(*arguments),)

    return function


# Each part takes and gives single precision, whatever its own.
class _Read(nn.Module):
    def __init__(self, text_encoder: nn.Module) -> None:
        super().__init__()
        self.text_encoder = text_encoder

    def forward(self, tokens: Tensor) -> Tensor:
        states: Tensor = self.text_encoder(tokens)[0]
        return states.float()


class _Encode(nn.Module):
    def __init__(self, vae: Any) -> None:
        super().__init__()
        self.vae = vae

    def forward(self, pictures: Tensor) -> Tensor:
        mode: Tensor = self.vae.encode(pictures.to(self.vae.dtype)).latent_dist.mode()
        return mode.float()


class _Decode(nn.Module):
    def __init__(self, vae: Any) -> None:
        super().__init__()
        self.vae = vae

    def forward(self, latents: Tensor) -> Tensor:
        pictures: Tensor = self.vae.decode(latents.to(self.vae.dtype), return_dict=False)[0]
        return pictures.float()


class _Denoise(nn.Module):
    def __init__(self, unet: Any) -> None:
        super().__init__()
        self.unet = unet

    def forward(self, noisy: Tensor, timestep: Tensor, states: Tensor) -> Tensor:
        kind = self.unet.dtype
        told = self.unet(noisy.to(kind), timestep, encoder_hidden_states=states.to(kind), return_dict=False)
        prediction: Tensor = told[0]
        return prediction.float()
