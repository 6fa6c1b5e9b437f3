"""The denoising loss of a goal planner on pairs of latents, with its optimiser and the moving average of the
weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import lightning
import numpy as np
import torch
from diffusers import DDIMScheduler
from diffusers.models.attention_processor import AttnProcessor
from numpy.typing import NDArray
from torch import Tensor, nn

from pentimento.contracts.errors import ContractError
from pentimento.contracts.ranges import above_zero, at_least
from pentimento.copainting.goal.planner import GoalPlanner, check_pictures
from pentimento.copainting.goal.ranks import Log
from pentimento.copainting.goal.vae import encode
from pentimento.copainting.jobs import generator_for
from pentimento.copainting.scenes.edits import Pair
from pentimento.semantics.devices import Precision, chosen_device, precision_on

_LARGEST_NORM: Final = 1.0  # of a step's gradient
_LAST_RATE: Final = 0.1  # share of the learning rate at the end of its cosine


@dataclass(frozen=True)
class Lora:
    """Low-rank updates of the UNet (Hu et al. 2022) instead of all its weights."""

    rank: int
    alpha: int
    """The updates are scaled by alpha / rank."""

    def __post_init__(self) -> None:
        at_least(self, 1, "rank", "alpha")


@dataclass(frozen=True)
class GoalTraining:
    """Hyper-parameters of training."""

    steps: int
    batch: int
    learning_rate: float
    """Of AdamW, after the warm-up; it decays along a cosine to a tenth."""
    warm_up: int
    """Steps in which the learning rate rises."""
    weight_decay: float
    drop_text: float
    """Fraction of the pairs shown without text; the next two without the input picture, and without both."""
    drop_image: float
    drop_both: float
    min_snr_gamma: float | None
    """Clamp of the signal-to-noise ratio in the loss weight (Hang et al. 2023: 5), or null for equal weights."""
    time_bias: float
    """Noise times are T (1 − (1 − u)^b) for uniform u. b = 1 is uniform; larger values sample noisy times more often,
    where the content is decided and the text matters. A short training would learn them last.
    """
    ema_decay: float
    """Of the moving average of the weights, which is the result of training; it starts as a plain mean. 0 takes the
    last weights, without memory for an average.
    """
    lora: Lora | None
    """Null trains the whole UNet."""
    train_text: bool
    """Whether the text encoder is trained, too: yes for a new one, no for a published one."""
    checkpoint_every: int
    """Steps."""
    gradient_checkpointing: bool
    """Compute the activations of the UNet's blocks again in the backward pass: less memory, the same weights, a third
    more time.
    """
    precision: Precision
    """A CPU without instructions for bfloat16 computes bf16-mixed in float32 (`semantics.devices.precision_on`)."""
    accelerator: Literal["cpu", "auto"]
    devices: int
    """GPUs, or processes on a machine without GPUs. The batch is divided equally among them."""
    strategy: Literal["auto", "ddp"]
    """Of Lightning: auto trains on one device in this process, and on several by ddp with a process for each."""
    seed: int

    def __post_init__(self) -> None:
        at_least(self, 1, "steps", "batch", "checkpoint_every", "devices")
        at_least(self, 0, "warm_up", "weight_decay", "drop_text", "drop_image", "drop_both", "ema_decay", "seed")
        above_zero(self, "learning_rate", "time_bias")
        if self.batch % self.devices:
            raise ValueError(
                f"batch is {self.batch}, which {self.devices} devices cannot share equally; take a multiple of devices."
            )
        if self.drop_text + self.drop_image + self.drop_both > 1:
            raise ValueError("drop_text, drop_image and drop_both are shares of the same pairs; their sum is above 1.")
        if self.ema_decay >= 1:
            raise ValueError(f"ema_decay is {self.ema_decay}; below 1, the average follows the weights.")
        if self.min_snr_gamma is not None:
            above_zero(self, "min_snr_gamma")


@dataclass(frozen=True, eq=False)
class LatentPairs:
    """Pairs in latent space; a picture that several pairs share is stored once."""

    latents: Tensor
    """Modes of the latents of each different picture, [P, C, h, w]. Published training samples a target's latents
    around the mode; in a short training that only adds noise to the loss.
    """
    input: Tensor
    """Index of the input picture of each pair, int64 [N]."""
    target: Tensor
    """Index of the target picture of each pair, int64 [N]."""
    tokens: Tensor
    """Tokens of the captions, int64 [N, T], padded."""


def encode_pairs(planner: GoalPlanner, pairs: Sequence[Pair], precision: Precision = "32-true") -> LatentPairs:
    """Encode pairs by a planner's autoencoder and tokenizer.

    With `bf16-mixed` the autoencoder takes half the time on a CPU with instructions for bfloat16, and latents differ by
    less than a hundredth; on other CPUs it computes in float32.

    Raises:
        ContractError: no pair, or pictures of a size that the planner does not take.
    """
    if not pairs:
        raise ContractError("There is no pair of pictures to train the goal planner on; make the dataset larger.")
    shapes = {picture.shape for pair in pairs for picture in (pair.input, pair.target)}
    if len(shapes) > 1:
        raise ContractError(f"The pairs' pictures are of {len(shapes)} sizes, e.g. {sorted(shapes)[:2]}; resize them.")
    check_pictures(planner, pairs[0].input[None])
    place: dict[bytes, int] = {}
    pictures: list[NDArray[np.uint8]] = []

    def index_of(picture: NDArray[np.uint8]) -> int:
        key = picture.tobytes()
        if key not in place:
            place[key] = len(pictures)
            pictures.append(picture)
        return place[key]

    inputs = [index_of(pair.input) for pair in pairs]
    targets = [index_of(pair.target) for pair in pairs]
    device = chosen_device().type
    with torch.autocast(device, torch.bfloat16, enabled=precision_on(device, precision) == "bf16-mixed"):
        latents = encode(planner.vae, np.stack(pictures)).float()
    return LatentPairs(
        latents,
        Tensor(inputs).long(),
        Tensor(targets).long(),
        tokens_of(planner, [pair.caption for pair in pairs]),
    )


def tokens_of(planner: GoalPlanner, captions: Sequence[str]) -> Tensor:
    """Tokens of captions as the pipeline itself computes them, int64 [N, T]: padded and truncated."""
    return planner.tokenizer(
        list(captions),
        padding="max_length",
        max_length=planner.tokenizer.model_max_length,
        truncation=True,
        return_tensors="pt",
    ).input_ids


class Denoising(lightning.LightningModule):
    """Loss and optimiser for Lightning, with the moving average of the trained weights."""

    def __init__(self, planner: GoalPlanner, pairs: LatentPairs, config: GoalTraining, log: Log) -> None:
        super().__init__()
        self.unet, self.text_encoder = planner.unet, planner.text_encoder
        self.scheduler = planner.scheduler
        self.scaling = float(planner.vae.config.scaling_factor)
        self.pairs, self.config, self.report = pairs, config, log
        self.no_text = tokens_of(planner, [""])
        self.unet.train()
        if config.accelerator == "cpu" or not torch.cuda.is_available():
            # PyTorch's flash attention on a CPU takes a fifth of a step for the gradient of a few dozen tokens.
            self.unet.set_attn_processor(AttnProcessor())
        if config.gradient_checkpointing:
            self.unet.enable_gradient_checkpointing()
        if config.lora is None:
            self.unet.requires_grad_(True)
        self.text_encoder.train(config.train_text).requires_grad_(config.train_text)
        self.losses: Tensor
        self.register_buffer("losses", torch.zeros(config.steps, dtype=torch.float64))
        self.average = nn.ParameterList(
            nn.Parameter(parameter.detach().clone(), requires_grad=False)
            for parameter in self._trained()
            if config.ema_decay
        )

    def training_step(self, _batch: int, _: int) -> Tensor:
        step, config, latents = self.global_step, self.config, self.pairs.latents
        generator = generator_for(config.seed, step)
        # All devices draw the same for the whole batch, and each goes on with its share.
        drawn = (
            self._chosen(step),
            torch.rand(config.batch, generator=generator),
            torch.randn((config.batch, *latents.shape[1:]), generator=generator),
            torch.rand(config.batch, generator=generator),
        )
        chosen, chance, noise, moment = (values[self.global_rank :: self.trainer.world_size] for values in drawn)
        clean = latents[self.pairs.target[chosen]] * self.scaling
        shown = latents[self.pairs.input[chosen]]  # not scaled, as published
        tokens = self.pairs.tokens[chosen]
        no_text = chance < config.drop_text + config.drop_both
        no_image = (chance >= config.drop_text) & (chance < config.drop_text + config.drop_both + config.drop_image)
        tokens = torch.where(no_text[:, None], self.no_text, tokens)
        shown = torch.where(no_image[:, None, None, None], torch.zeros(()), shown)
        share = 1 - (1 - moment) ** config.time_bias
        last = self.scheduler.config.num_train_timesteps - 1
        times = (share * (last + 1)).long().clamp(max=last)
        noisy = self.scheduler.add_noise(clean, noise, times)
        wanted = wanted_output(self.scheduler, clean, noise, times)
        weight = loss_weight(self.scheduler, times, config.min_snr_gamma)
        device = self.device
        text = self.text_encoder(tokens.to(device))[0]
        prediction = self.unet(torch.cat([noisy, shown], 1).to(device), times.to(device), text).sample
        loss = ((prediction.float() - wanted.to(device)).square().mean((1, 2, 3)) * weight.to(device)).mean()
        of_devices: Any = self.all_gather(loss.detach())
        mean = of_devices.mean()
        self.losses[step] = mean
        if self.trainer.is_global_zero:
            self.report("loss", float(mean), step)
        return loss

    def on_before_optimizer_step(self, *_: Any) -> None:
        """Clip the gradients; Lightning refuses to clip those of a fused optimiser in mixed precision."""
        torch.nn.utils.clip_grad_norm_(self._trained(), _LARGEST_NORM)

    def optimizer_step(self, *arguments: Any, **keywords: Any) -> None:
        """Update the weights and, before any checkpoint is written, their moving average."""
        super().optimizer_step(*arguments, **keywords)
        if not self.config.ema_decay:
            return
        decay = min(self.config.ema_decay, self.global_step / (self.global_step + 1))
        with torch.no_grad():
            torch._foreach_lerp_([*self.average.parameters()], [*self._trained()], 1 - decay)

    def configure_optimizers(self) -> Any:
        config = self.config
        optimizer = torch.optim.AdamW(
            self._trained(),
            lr=config.learning_rate,
            weight_decay=config.weight_decay,
            betas=(0.9, 0.99),
            fused=config.precision != "16-mixed",  # a fused one would unscale the clipped gradients once more
        )
        schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, self._rate)
        return [optimizer], [{"scheduler": schedule, "interval": "step"}]

    @torch.no_grad()
    def take_averages(self) -> None:
        """Replace the weights by their moving averages, if there are any."""
        if self.config.ema_decay:
            for parameter, average in zip(self._trained(), self.average, strict=True):
                parameter.copy_(average)

    def _trained(self) -> list[nn.Parameter]:
        return [p for part in (self.unet, self.text_encoder) for p in part.parameters() if p.requires_grad]

    def _rate(self, step: int) -> float:
        config = self.config
        if step < config.warm_up:
            return (step + 1) / (config.warm_up + 1)
        done = min(1.0, (step - config.warm_up) / max(1, config.steps - config.warm_up))
        return _LAST_RATE + (1 - _LAST_RATE) * 0.5 * (1 + float(torch.cos(torch.tensor(torch.pi * done))))

    def _chosen(self, step: int) -> Tensor:
        """Indices of the pairs of a step: each epoch shows all pairs once in a new random order."""
        number, first = len(self.pairs.input), step * self.config.batch
        positions = range(first, first + self.config.batch)
        orders = {
            sweep: torch.randperm(number, generator=generator_for(self.config.seed, 1, sweep))
            for sweep in {position // number for position in positions}
        }
        return torch.stack([orders[position // number][position % number] for position in positions])


def wanted_output(scheduler: DDIMScheduler, clean: Tensor, noise: Tensor, times: Tensor) -> Tensor:
    """The target of the UNet for noised latents [B, C, h, w]: the noise, the velocity or the clean latents."""
    match scheduler.config.prediction_type:
        case "epsilon":
            return noise
        case "v_prediction":
            return scheduler.get_velocity(clean, noise, times)
        case "sample":
            return clean
        case other:
            raise ValueError(f"prediction type {other}")


def loss_weight(scheduler: DDIMScheduler, times: Tensor, gamma: float | None) -> Tensor:
    """Weight [B] of the squared error of `wanted_output`: 1, or min-SNR-γ (Hang et al. 2023, section 3.4).

    With SNR = ᾱ / (1 − ᾱ), the error of the clean latents has the weight min(SNR, γ). An error of the noise is SNR
    times, one of the velocity SNR + 1 times that of the clean latents, so their weights are divided by these factors.
    At zero SNR the velocity's weight is 0, as published.
    """
    if gamma is None:
        return torch.ones(len(times))
    signal = scheduler.alphas_cumprod[times]
    ratio = signal / (1 - signal)
    clamped = ratio.clamp(max=gamma)
    match scheduler.config.prediction_type:
        case "epsilon":
            return clamped / ratio
        case "v_prediction":
            return clamped / (ratio + 1)
        case _:
            return clamped
