"""A small autoencoder for a goal planner, trained on scenes, pen drawings of them and random strokes.

A goal planner can keep only what its autoencoder reconstructs, such as the lines of an existing drawing. So lines are
part of the training data, and the resolution is halved only twice.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from diffusers import AutoencoderKL
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import avg_pool2d

from pentimento.contracts.ranges import above_zero, at_least
from pentimento.copainting.jobs import generator_for
from pentimento.copainting.scenes.ink import ink_recall, pen_drawing, random_pen, random_strokes
from pentimento.semantics.devices import chosen_device, in_batches, precision_on

Log = Callable[[str, float, int], None]

_KL_WEIGHT: Final = 1e-6  # as in latent diffusion (Rombach et al. 2022): it only keeps the latents in bounds
_OPPONENT: Final = ((1.0, -1.0, 0.0), (-0.5, -0.5, 1.0))  # red against green, blue against yellow, of RGB
_COLOUR_LATENTS: Final = slice(-len(_OPPONENT), None)  # the latents that are taught the mean colour of their cell
_COLOUR_SCALE: Final = 2.0  # of that colour: the latents' spread is about 1
_COLOUR_WEIGHT: Final = 2.0  # of the error of colours, and of those latents
_WARM_UP: Final = 20  # steps
_STROKES: Final = (2, 40)  # in a picture of random strokes
_WIDTHS_PX: Final = (1.2, 4.0)  # of random strokes
_CHUNK: Final = 64  # pictures encoded or decoded at once


@dataclass(frozen=True)
class VaeConfig:
    """The autoencoder and its training."""

    channels: tuple[int, ...]
    """Of each resolution, the finest first; each further one halves the resolution."""
    latent_channels: int
    """Instruct-Pix2Pix: 4, so that its UNet has 8 input channels."""
    pictures: int
    """Scenes in the training data, with as many pen drawings and as many pictures of random strokes."""
    steps: int
    batch: int
    learning_rate: float

    def __post_init__(self) -> None:
        at_least(self, 1, "latent_channels", "pictures", "steps", "batch")
        above_zero(self, "learning_rate")


@dataclass(frozen=True)
class DecoderConfig:
    """Further training of a decoder on pictures of one kind."""

    steps: int
    batch: int
    learning_rate: float

    def __post_init__(self) -> None:
        at_least(self, 1, "steps", "batch")
        above_zero(self, "learning_rate")


def build_vae(config: VaeConfig, side_px: int) -> AutoencoderKL:
    """The untrained autoencoder; its latents are `side_px` / 2^(resolutions - 1) wide."""
    levels = len(config.channels)
    return AutoencoderKL(
        down_block_types=("DownEncoderBlock2D",) * levels,
        up_block_types=("UpDecoderBlock2D",) * levels,
        block_out_channels=config.channels,
        layers_per_block=1,
        latent_channels=config.latent_channels,
        norm_num_groups=8,
        sample_size=side_px,
        mid_block_add_attention=False,
    )


def vae_pictures(scenes: Sequence[NDArray[np.uint8]], seed: int) -> NDArray[np.uint8]:
    """Training data, uint8 [3 n, H, W, 3]: n scenes, pen drawings of them, and n pictures of random strokes."""
    lines, strokes = _drawings(scenes, seed, 1)
    return np.concatenate([np.stack([*scenes]), lines, strokes])


def train_vae(
    pictures: NDArray[np.uint8],
    config: VaeConfig,
    seed: int,
    *,
    crop_px: int | None = None,
    teach_colours: bool = False,
    half_precision: bool = False,
    log: Log,
) -> AutoencoderKL:
    """Train an autoencoder on pictures, uint8 [N, H, W, 3], with the loss L1 + L2; `log("vae_loss", value, step)` at
    each step.

    Each step sees random squares of `crop_px` of its pictures; None shows them whole. `teach_colours` adds the error of
    the opponent colours, and teaches the last two latents the mean opponent colours of their cell: without it, a short
    training on drawings learns their lines and hardly their hues. `half_precision` computes in
    bfloat16 where PyTorch's autocast does and the CPU has instructions for it, and keeps weights in float32.

    Its `scaling_factor` is set to the inverse standard deviation of the latents, as in latent diffusion.
    """
    torch.manual_seed(seed)
    vae = build_vae(config, pictures.shape[1]).train()
    half_precision = half_precision and precision_on("cpu", "bf16-mixed") == "bf16-mixed"
    optimizer = torch.optim.AdamW(vae.parameters(), config.learning_rate, betas=(0.9, 0.99), weight_decay=0.0)
    for step in range(config.steps):
        generator = generator_for(seed, step)
        chosen = torch.randint(0, len(pictures), (config.batch,), generator=generator)
        shown = as_model_input(pictures[chosen.numpy()])
        if crop_px is not None:
            shown = _random_crops(shown, crop_px, generator)
        with torch.autocast("cpu", torch.bfloat16, enabled=half_precision):
            latents = vae.encode(shown).latent_dist
            noise = torch.randn(latents.mean.shape, generator=generator)
            again = vae.decode(latents.mean + latents.std * noise).sample
        loss = _reconstruction_loss(again.float(), shown) + _KL_WEIGHT * latents.kl().float().mean()
        if teach_colours:
            loss = loss + _COLOUR_WEIGHT * _colour_loss(again.float(), shown, latents.mean.float())
        _descend(optimizer, loss, config, step)
        log("vae_loss", float(loss.detach()), step)
    vae.eval().requires_grad_(False)
    spread = float(encode(vae, pictures[:: max(1, len(pictures) // 256)]).std())
    vae.register_to_config(scaling_factor=round(1 / spread, 4))
    return vae


def train_decoder(
    vae: AutoencoderKL, pictures: NDArray[np.uint8], config: DecoderConfig, *, seed: int, log: Log
) -> None:
    """Train the decoder further, in place, on pictures, uint8 [N, H, W, 3]; the latents do not change.

    Stable Diffusion's decoder was fine-tuned the same way. The UNet stays valid, and lines are reconstructed in the
    style of the tool. `log("decoder_loss", value, step)` at each step.
    """
    learning = [*vae.post_quant_conv.parameters(), *vae.decoder.parameters()]
    for parameter in learning:
        parameter.requires_grad_(True)
    optimizer = torch.optim.AdamW(learning, config.learning_rate, betas=(0.9, 0.99), weight_decay=0.0)
    for step in range(config.steps):
        chosen = torch.randint(0, len(pictures), (config.batch,), generator=generator_for(seed, step))
        shown = pictures[chosen.numpy()]
        latents = encode(vae, shown).to(vae.device)
        loss = _reconstruction_loss(vae.decode(latents).sample, as_model_input(shown).to(vae.device))
        _descend(optimizer, loss, config, step)
        log("decoder_loss", float(loss.detach()), step)
    vae.requires_grad_(False)


@torch.no_grad()
def encode(vae: AutoencoderKL, pictures: NDArray[np.uint8]) -> Tensor:
    """Modes of the latents of pictures, [B, C, h, w], on the CPU; the autoencoder moves to the chosen device."""
    device = vae.to(chosen_device()).device
    return torch.cat(
        in_batches(
            lambda part: vae.encode(as_model_input(pictures[part]).to(device)).latent_dist.mode().cpu(),
            len(pictures),
            _CHUNK,
        )
    )


@torch.no_grad()
def round_trip(vae: AutoencoderKL, pictures: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Reconstructions of pictures, uint8 [B, H, W, 3]."""
    latents = encode(vae, pictures)
    return np.concatenate(
        in_batches(lambda part: as_pictures(vae.decode(latents[part].to(vae.device)).sample), len(latents), _CHUNK)
    )


def ink_after_round_trip(
    vae: AutoencoderKL, scenes: Sequence[NDArray[np.uint8]], seed: int
) -> dict[str, dict[str, float | None]]:
    """How well reconstructions keep ink, for pen drawings of the scenes and for random strokes.

    `recall` is the fraction of the ink that is still there within 1 px. `precision` is the fraction of the
    reconstructed ink that was ink before; an all-black reconstruction has a recall of 1 and a low precision.
    """
    lines, strokes = _drawings(scenes, seed, 2)
    scores: dict[str, dict[str, float | None]] = {}
    for name, pictures in (("lines", lines), ("strokes", strokes)):
        again = round_trip(vae, pictures)
        shares = {"recall": ink_recall(pictures, again), "precision": ink_recall(again, pictures)}
        scores[name] = {kind: None if math.isnan(share) else share for kind, share in shares.items()}
    return scores


def _random_crops(images: Tensor, side_px: int, generator: torch.Generator) -> Tensor:
    """A random square of each image [B, 3, H, W]."""
    bounds = [size - side_px + 1 for size in images.shape[2:]]
    corners = [torch.randint(0, bound, (len(images),), generator=generator).tolist() for bound in bounds]
    squares = [
        image[:, top : top + side_px, left : left + side_px]
        for image, top, left in zip(images, *corners, strict=True)
    ]  # fmt: skip
    return torch.stack(squares)


def _reconstruction_loss(reconstructed: Tensor, pictures: Tensor) -> Tensor:
    error = reconstructed - pictures
    return error.abs().mean() + 0.5 * error.square().mean()


def _colour_loss(reconstructed: Tensor, pictures: Tensor, latents: Tensor) -> Tensor:
    """The error of the opponent colours, and of the latents [B, C, h, w] that are to hold their means."""
    opponent = pictures.new_tensor(_OPPONENT)
    colours = torch.einsum("kc,bchw->bkhw", opponent, pictures)
    error = torch.einsum("kc,bchw->bkhw", opponent, reconstructed) - colours
    means = avg_pool2d(colours, pictures.shape[-1] // latents.shape[-1])
    return error.abs().mean() + (latents[:, _COLOUR_LATENTS] - _COLOUR_SCALE * means).square().mean()


def _descend(optimizer: torch.optim.Optimizer, loss: Tensor, config: VaeConfig | DecoderConfig, step: int) -> None:
    """One optimiser step; after a warm-up the learning rate decays to 0."""
    for group in optimizer.param_groups:
        group["lr"] = config.learning_rate * min(1.0, (step + 1) / _WARM_UP) * (1 - step / config.steps)
    optimizer.zero_grad()
    loss.backward()  # type: ignore[no-untyped-call]
    torch.nn.utils.clip_grad_norm_([p for group in optimizer.param_groups for p in group["params"]], 1.0)
    optimizer.step()


def _drawings(scenes: Sequence[NDArray[np.uint8]], seed: int, use: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """A pen drawing of each scene, and as many pictures of random strokes, uint8 [n, H, W, 3] each."""
    lines, strokes = [], []
    for index, scene in enumerate(scenes):
        generator = np.random.default_rng([seed, use, index])
        lines.append(pen_drawing(scene, np.ones(scene.shape[:2], bool), random_pen(generator)))
        strokes.append(stroke_picture(scene.shape[0], generator))
    return np.stack(lines), np.stack(strokes)


def stroke_picture(side_px: int, generator: np.random.Generator) -> NDArray[np.uint8]:
    """A few or many random strokes, sRGB [side, side, 3]."""
    return random_strokes(side_px, int(generator.integers(*_STROKES)), _WIDTHS_PX, generator)


def as_model_input(pictures: NDArray[np.uint8]) -> Tensor:
    """uint8 [B, H, W, 3] as float32 [B, 3, H, W] in [-1, 1]."""
    return torch.from_numpy(np.ascontiguousarray(pictures)).permute(0, 3, 1, 2).float() / 127.5 - 1


def as_pictures(images: Tensor) -> NDArray[np.uint8]:
    """Float [B, 3, H, W] in [-1, 1] as uint8 [B, H, W, 3]."""
    bounded = ((images.float().clamp(-1, 1) + 1) * 127.5).round().to(torch.uint8)
    return bounded.permute(0, 2, 3, 1).contiguous().cpu().numpy()
