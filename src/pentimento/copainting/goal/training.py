"""Train a goal planner as Instruct-Pix2Pix is trained: to denoise the target, given the input picture and the text.

Each step's pairs, noise, times and dropped conditions depend on (seed, step) only, and a checkpoint holds everything
else that training changes. So a run that was killed and resumed ends with the same weights, bit for bit.

On several devices, each takes its share of a step's pairs, with the noise and the drops that they have on one: the
mean of the devices' gradients is one device's, up to rounding.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import lightning
import torch
from diffusers import DDIMScheduler
from lightning.fabric.plugins.environments.lightning import LightningEnvironment
from torch import Tensor, nn
from torch.utils.data import DataLoader

from pentimento.contracts.errors import ConfigError
from pentimento.contracts.ranges import above_zero, at_least
from pentimento.copainting.goal.checkpoints import KeepCheckpoint, latest_checkpoint
from pentimento.copainting.goal.latent_pairs import LatentPairs, tokens_of
from pentimento.copainting.goal.planner import GoalPlanner, load_goal_planner, save_goal_planner
from pentimento.copainting.goal.ranks import Log, run_ranks
from pentimento.copainting.goal.silence import quiet_lightning
from pentimento.copainting.seeds import generator_for

_LORA_LAYERS: Final = ("to_q", "to_k", "to_v", "to_out.0", "conv1", "conv2", "conv_in", "conv_out")
_PARTS: Final = ("unet", "text_encoder")  # of a planner: what training may change
_LAST_RATE: Final = 0.1  # share of the learning rate at the end of its cosine


@dataclass(frozen=True)
class Lora:
    """Low-rank updates of the UNet (Hu et al. 2022) in place of all its weights."""

    rank: int
    alpha: int
    """The updates are scaled by alpha / rank."""

    def __post_init__(self) -> None:
        at_least(self, 1, "rank", "alpha")


@dataclass(frozen=True)
class GoalTraining:
    """How a goal planner is trained."""

    steps: int
    batch: int
    learning_rate: float
    """AdamW's, after the warm-up; it falls along a cosine to a tenth."""
    warm_up: int
    """Steps in which the learning rate rises."""
    weight_decay: float
    drop_text: float
    """Share of the pairs shown without their text; as often without their picture, and again without both."""
    drop_image: float
    drop_both: float
    min_snr_gamma: float | None
    """Clamp of the signal-to-noise ratio in the loss's weight (Hang et al. 2023: 5), or null: all times weigh alike."""
    time_bias: float
    """Noise times are T (1 − (1 − u)^b) for uniform u and this b: 1 is uniform, above it more of them are noisy. What a
    picture will show is decided there, and that is what text tells: in short training it is learned last."""
    ema_decay: float
    """Of the weights' moving average, which is what training gives; it starts as a plain mean."""
    lora: Lora | None
    """Null trains the whole UNet."""
    train_text: bool
    """Whether the text encoder learns, too (a new one must; a published one is kept)."""
    checkpoint_every: int
    """Steps."""
    precision: Literal["32-true", "bf16-mixed", "16-mixed"]
    accelerator: Literal["cpu", "auto"]
    devices: int
    """GPUs, or processes where there is none. Each takes an equal share of the batch."""
    strategy: Literal["auto", "ddp"]
    """Lightning's: auto trains on one device in this process, and on several by ddp, a process for each."""
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


def train_goal_planner(
    planner: GoalPlanner, pairs: LatentPairs, config: GoalTraining, scratch: Path | None, log: Log
) -> list[float]:
    """Train the planner's UNet (and text encoder, where the config says so) in place; it ends with averaged weights.

    Gives the loss of each step, and calls `log("loss", value, step)` as it goes, in this process. With a `scratch`
    folder, checkpoints are kept there, and what an earlier call left in it is continued, on whatever number of devices
    that was: the caller gives each training its own folder.

    Raises:
        ConfigError: more devices than GPUs.
    """
    if config.devices == 1 and config.strategy == "auto":
        return _train(planner, pairs, config, scratch, log)
    gpus = torch.cuda.device_count()
    if config.accelerator == "auto" and 0 < gpus < config.devices:
        raise ConfigError(
            f"devices is {config.devices}, but this machine has {gpus} GPUs; set devices to {gpus} or less."
        )
    if scratch is not None:
        scratch.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=scratch) as name:
        folder = Path(name)
        save_goal_planner(planner, folder / "untrained")
        torch.save(vars(pairs), folder / "pairs.pt")  # and not handed over: containers have little shared memory
        run_ranks(_train_rank, (folder, config, scratch), config.devices, log)
        trained = torch.load(folder / "trained.pt", weights_only=True)
    for name in _PARTS:
        getattr(planner, name).load_state_dict(trained[name])
        getattr(planner, name).eval().requires_grad_(False)
    losses: list[float] = trained["losses"]
    return losses


def _train_rank(rank: int, folder: Path, config: GoalTraining, scratch: Path | None, log: Log) -> None:
    """Train the planner in a folder, as one process of several; all end with the same, and the first one writes it."""
    planner = load_goal_planner(folder / "untrained")
    pairs = LatentPairs(**torch.load(folder / "pairs.pt", weights_only=True, mmap=True))
    losses = _train(planner, pairs, config, scratch, log)
    if rank == 0:
        states = {name: getattr(planner, name).state_dict() for name in _PARTS}
        torch.save(states | {"losses": losses}, folder / "trained.pt")


def _train(
    planner: GoalPlanner, pairs: LatentPairs, config: GoalTraining, scratch: Path | None, log: Log
) -> list[float]:
    """`train_goal_planner` in this process: the only one, or a rank of several."""
    torch.manual_seed(config.seed)  # of LoRA's first values
    if config.lora is not None:
        _add_lora(planner, config.lora)
    module = _Denoising(planner, pairs, config, log)
    callbacks = [] if scratch is None else [KeepCheckpoint(scratch, config.checkpoint_every)]
    with quiet_lightning():
        trainer = lightning.Trainer(
            max_steps=config.steps,
            accelerator=config.accelerator,
            devices=config.devices,
            strategy=config.strategy,
            precision=config.precision,
            gradient_clip_val=1.0,
            callbacks=[*callbacks],
            plugins=LightningEnvironment(),  # no other processes than ours, in a cluster's job either
            logger=False,
            enable_checkpointing=False,
            enable_progress_bar=False,
            enable_model_summary=False,
            use_distributed_sampler=False,
        )
        # The loader only counts the steps: what each shows is drawn in the step itself.
        steps: DataLoader[int] = DataLoader(range(config.steps), batch_size=None)  # type: ignore[arg-type]
        start = None if scratch is None else latest_checkpoint(scratch)
        try:
            trainer.fit(module, steps, ckpt_path=start, weights_only=True)
        except SystemExit as exit_:
            if isinstance(exit_.__context__, KeyboardInterrupt):  # Lightning would end the process itself
                raise exit_.__context__ from None
            raise
    module.cpu()
    module.take_averages()
    if config.lora is not None:
        planner.unet.fuse_lora()
        planner.unet.unload_lora()
    for name in _PARTS:
        getattr(planner, name).eval().requires_grad_(False)
    return [float(loss) for loss in module.losses]


class _Denoising(lightning.LightningModule):
    """The loss of a step, the optimiser, and the moving average of what is trained."""

    def __init__(self, planner: GoalPlanner, pairs: LatentPairs, config: GoalTraining, log: Log) -> None:
        super().__init__()
        self.unet, self.text_encoder = planner.unet, planner.text_encoder
        self.scheduler = planner.scheduler
        self.scaling = float(planner.vae.config.scaling_factor)
        self.pairs, self.config, self.report = pairs, config, log
        self.no_text = tokens_of(planner, [""])
        self.unet.train()
        if config.lora is None:
            self.unet.requires_grad_(True)
        self.text_encoder.train(config.train_text).requires_grad_(config.train_text)
        self.losses: Tensor
        self.register_buffer("losses", torch.zeros(config.steps, dtype=torch.float64))
        self.average = nn.ParameterList(
            nn.Parameter(parameter.detach().clone(), requires_grad=False) for parameter in self._trained()
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
        chosen, luck, noise, moment = (values[self.global_rank :: self.trainer.world_size] for values in drawn)
        clean = latents[self.pairs.target[chosen]] * self.scaling
        shown = latents[self.pairs.input[chosen]]  # not scaled, as published
        tokens = self.pairs.tokens[chosen]
        no_text = luck < config.drop_text + config.drop_both
        no_image = (luck >= config.drop_text) & (luck < config.drop_text + config.drop_both + config.drop_image)
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
        made = self.unet(torch.cat([noisy, shown], 1).to(device), times.to(device), text).sample
        loss = ((made.float() - wanted.to(device)).square().mean((1, 2, 3)) * weight.to(device)).mean()
        of_devices: Any = self.all_gather(loss.detach())
        mean = of_devices.mean()
        self.losses[step] = mean
        if self.trainer.is_global_zero:
            self.report("loss", float(mean), step)
        return loss

    def optimizer_step(self, *arguments: Any, **keywords: Any) -> None:
        """A step of the weights and, before any checkpoint is written, of their average."""
        super().optimizer_step(*arguments, **keywords)
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
            fused=config.precision == "32-true",  # Lightning clips no gradients of a fused one in mixed precision
        )
        schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, self._rate)
        return [optimizer], [{"scheduler": schedule, "interval": "step"}]

    @torch.no_grad()
    def take_averages(self) -> None:
        """Put the moving average in the weights' place."""
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
        """The pairs of a step: each pass shows all of them once, in an order of its own."""
        number, first = len(self.pairs.input), step * self.config.batch
        positions = range(first, first + self.config.batch)
        orders = {
            sweep: torch.randperm(number, generator=generator_for(self.config.seed, 1, sweep))
            for sweep in {position // number for position in positions}
        }
        return torch.stack([orders[position // number][position % number] for position in positions])


def wanted_output(scheduler: DDIMScheduler, clean: Tensor, noise: Tensor, times: Tensor) -> Tensor:
    """What the UNet should give for noised latents [B, C, h, w]: the noise, the velocity or the clean latents."""
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

    With SNR = ᾱ / (1 − ᾱ), the error of the clean latents weighs min(SNR, γ); that of the noise is SNR times it and
    that of the velocity SNR + 1 times it, so their weights are as many times less. At zero SNR (pure noise) a network
    would learn nothing of the clean latents: the velocity's weight is 0 there, as published.
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


def _add_lora(planner: GoalPlanner, lora: Lora) -> None:
    from peft import LoraConfig

    planner.unet.requires_grad_(False)
    planner.unet.add_adapter(
        LoraConfig(r=lora.rank, lora_alpha=lora.alpha, init_lora_weights="gaussian", target_modules=list(_LORA_LAYERS))
    )
