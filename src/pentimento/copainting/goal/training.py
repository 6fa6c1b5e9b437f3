"""Training of a goal planner as of Instruct-Pix2Pix: denoise the target, given the input picture and the text.

Pairs, noise, times and dropped conditions of a step depend on (seed, step) only. A checkpoint holds everything else
that training changes. A run that was killed and resumed therefore ends with the same weights, bit for bit.

On several devices, each computes its part of a step's batch, with the noise and the dropped conditions that these
pairs have on one device. The mean of the devices' gradients equals the gradient of one device up to rounding.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, Final

import lightning
import torch
from lightning.fabric.plugins.environments.lightning import LightningEnvironment
from torch.utils.data import DataLoader

from pentimento.contracts.errors import ConfigError, PentimentoError
from pentimento.copainting.goal.denoising import Denoising, GoalTraining, LatentPairs, Lora
from pentimento.copainting.goal.planner import GoalPlanner, load_goal_planner, save_goal_planner
from pentimento.copainting.goal.ranks import Log, run_ranks
from pentimento.dynamics.quiet_lightning import quiet_lightning
from pentimento.semantics.devices import Precision, precision_on

_LORA_LAYERS: Final = ("to_q", "to_k", "to_v", "to_out.0", "conv1", "conv2", "conv_in", "conv_out")
_PARTS: Final = ("unet", "text_encoder")  # of a planner: what training may change

_PATTERN: Final = "step-*.ckpt"


def train_goal_planner(
    planner: GoalPlanner, pairs: LatentPairs, config: GoalTraining, *, scratch: Path | None, log: Log
) -> list[float]:
    """Train the UNet of a planner (and its text encoder, if configured) in place; it ends with the averaged weights.

    Return the loss of each step, and call `log("loss", value, step)` in this process. Checkpoints are written to the
    `scratch` folder, if given, and training continues from the checkpoint of an earlier call there, on any number of
    devices. The caller gives each training its own folder.

    Raises:
        ConfigError: more devices than GPUs.
        PentimentoError: a step does not fit into the device's memory.
    """
    if config.devices == 1 and config.strategy == "auto":
        return _train(planner, pairs, config, scratch=scratch, log=log)
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
    """Train the planner of a folder as one process of several; all end with the same weights, and rank 0 writes
    them."""
    planner = load_goal_planner(folder / "untrained")
    pairs = LatentPairs(**torch.load(folder / "pairs.pt", weights_only=True, mmap=True))
    losses = _train(planner, pairs, config, scratch=scratch, log=log)
    if rank == 0:
        states = {name: getattr(planner, name).state_dict() for name in _PARTS}
        torch.save(states | {"losses": losses}, folder / "trained.pt")


def _train(
    planner: GoalPlanner, pairs: LatentPairs, config: GoalTraining, *, scratch: Path | None, log: Log
) -> list[float]:
    """`train_goal_planner` in this process: the only one, or one rank of several."""
    torch.manual_seed(config.seed)  # of LoRA's first values
    if config.lora is not None:
        _add_lora(planner, config.lora)
    module = Denoising(planner, pairs, config, log)
    callbacks = [] if scratch is None else [KeepCheckpoint(scratch, config.checkpoint_every)]
    with quiet_lightning():
        trainer = lightning.Trainer(
            max_steps=config.steps,
            accelerator=config.accelerator,
            devices=config.devices,
            strategy=config.strategy,
            precision=computed_precision(config),
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
        except torch.OutOfMemoryError as error:
            raise PentimentoError(
                f"A batch of {config.batch} pairs does not fit into the device's memory "
                f"({str(error).splitlines()[0]}); halve training.batch, or train low-rank updates (training.lora). "
                "What was trained up to the last checkpoint is kept."
            ) from error
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


def computed_precision(config: GoalTraining) -> Precision:
    """The precision in which training computes on this machine, which may lack instructions for the configured one."""
    on_gpu = config.accelerator == "auto" and (torch.cuda.is_available() or torch.backends.mps.is_available())
    return precision_on("gpu" if on_gpu else "cpu", config.precision)


def _add_lora(planner: GoalPlanner, lora: Lora) -> None:
    from peft import LoraConfig

    planner.unet.requires_grad_(False)
    planner.unet.add_adapter(
        LoraConfig(r=lora.rank, lora_alpha=lora.alpha, init_lora_weights="gaussian", target_modules=list(_LORA_LAYERS))
    )


class KeepCheckpoint(lightning.Callback):
    """Write the complete training state every so many steps, and delete the previous checkpoint afterwards."""

    def __init__(self, folder: Path, every: int) -> None:
        self.folder, self.every = folder, every

    def on_train_batch_end(self, trainer: lightning.Trainer, *_: Any) -> None:
        """Called by Lightning after each step, in every process; only rank 0 changes the folder."""
        if trainer.global_step % self.every:
            return
        if trainer.is_global_zero:
            self.folder.mkdir(parents=True, exist_ok=True)
        done = self.folder / f"step-{trainer.global_step:08d}.ckpt"
        unfinished = done.with_suffix(".part")
        trainer.save_checkpoint(unfinished)  # all processes meet here
        if not trainer.is_global_zero:
            return
        unfinished.replace(done)
        for old in self.folder.glob(_PATTERN):
            if old != done:
                old.unlink()


def latest_checkpoint(folder: Path) -> Path | None:
    """The newest complete checkpoint in a folder, or None."""
    return max(folder.glob(_PATTERN), default=None)
