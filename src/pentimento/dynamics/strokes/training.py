"""Fit Traj2Stroke to measured strokes on the thesis's weighted L1 (5.3.4)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import lightning
import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader, TensorDataset

from pentimento.contracts.errors import ContractError
from pentimento.contracts.ranges import above_zero, at_least
from pentimento.dynamics.quiet_lightning import quiet_lightning
from pentimento.dynamics.strokes.evaluation import predict, weighted_l1
from pentimento.dynamics.strokes.resolution import Auto, check_sampling
from pentimento.dynamics.strokes.samples import StrokeSamples
from pentimento.dynamics.strokes.traj2stroke import Traj2Stroke, Traj2StrokeParameters

Log = Callable[[str, float, int], None]

_MIN_CONTACT = 0.25
"""Minimum half-width at contact that a fit starts from, as a share of the mean half-width."""
_MAX_SLOPE = 50.0  # metres of half-width for each metre of press; more means a table in millimetres


@dataclass(frozen=True)
class TrainingConfig:
    """How Traj2Stroke is fitted."""

    path_points: int
    """Points n of a path (thesis 5.3.2: 32)."""
    pixels_per_m: float | Auto
    """Photographs finer than this are averaged down to about it; auto: by line width and windows."""
    margin_m: float | Auto
    """Windows are trimmed to this much around the commanded path; auto likewise."""
    epochs: int
    batch: int
    learning_rate: float
    """Adam's; lengths are in mm inside the model."""
    ink_weight: float
    """How much more an inked pixel weighs than a blank one in the L1 (thesis 5.3.4)."""
    held_out: float
    """Share of the actions in the test split."""
    seed: int

    def __post_init__(self) -> None:
        at_least(self, 1, "epochs", "batch")
        at_least(self, 2, "path_points")
        at_least(self, 0, "seed")
        above_zero(self, "learning_rate", "ink_weight", "held_out")
        check_sampling(self)
        if self.held_out >= 1:
            raise ValueError(f"held_out is {self.held_out}; below 1, some actions are left to train on.")


def split_by_action(samples: StrokeSamples, held_out: float, seed: int) -> tuple[StrokeSamples, StrokeSamples]:
    """(training, held-out) samples; repeats of one action stay together.

    Raises:
        ContractError: no action is left to train on, or no stroke of a part left ink that can be seen.
    """
    actions = np.unique(samples.action.numpy())
    order = np.random.default_rng(seed).permutation(len(actions))
    apart = actions[order[: max(1, round(held_out * len(actions)))]]
    if len(apart) == len(actions):
        raise ContractError(
            f"Of {len(actions)} actions in the strokes, {len(apart)} would be held out and none trained on: "
            "record more strokes or lower train_stroke_dynamics.held_out."
        )
    is_apart = torch.from_numpy(np.isin(samples.action.numpy(), apart))
    parts = samples.pick(~is_apart), samples.pick(is_apart)
    for name, part in zip(("training", "held-out"), parts, strict=True):
        if not part.ink.any():
            raise ContractError(
                f"None of the {len(part.path)} {name} strokes left ink that can be seen on its path: look at the "
                "table's photographs, windows and color_srgb, or record more strokes."
            )
    return parts


def first_guess(samples: StrokeSamples) -> Traj2StrokeParameters:
    """Start values from the data: half-width = inked area / (2 · length), regressed on the mean press depth.

    Raises:
        ContractError: the regression slope is not that of any tool.
    """
    area = samples.ink.flatten(1).sum(1) / samples.pixels_per_m**2
    length = samples.path[..., 1:3].diff(dim=1).norm(dim=-1).sum(1)
    press = (-samples.path[..., 3]).clamp(min=0.0).mean(1)
    usable = (area > 0) & (length > 0)
    # A round end adds its disc: area = 2 w L + π w².
    half = (torch.sqrt(length**2 + torch.pi * area) - length)[usable] / torch.pi
    press = press[usable]
    spread = float(press.var(unbiased=False)) if len(press) else 0.0
    slope = float(((press - press.mean()) * half).mean()) / spread if spread > 1e-10 else 0.0
    slope = max(slope, 0.05)
    if slope > _MAX_SLOPE:
        raise ContractError(
            f"The strokes' half-width seems to grow by {slope:.3g} m for each metre of press: check that the table's "
            "paths and windows are in metres."
        )
    contact = float(half.mean() - slope * press.mean()) if len(press) else 1e-3
    minimum = _MIN_CONTACT * float(half.mean()) if len(press) else contact
    return Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), slope, max(contact, minimum), 0.3, 0.9)


def train(samples: StrokeSamples, config: TrainingConfig, log: Log) -> Traj2Stroke:
    """Fit the model; ``log("weighted_l1", value, epoch)`` is called after every epoch."""
    torch.manual_seed(config.seed)
    model = Traj2Stroke(first_guess(samples))
    descend(model, lambda index: predict(model, samples.pick(index)), samples, config=config, log=log)
    return model.eval()


def descend(
    model: torch.nn.Module,
    predict: Callable[[Tensor], Tensor],
    samples: StrokeSamples,
    *,
    config: TrainingConfig,
    log: Log,
    after_epoch: Callable[[int], None] = lambda _: None,
) -> None:
    """Lower the weighted L1 over a model's parameters, by Adam with a rate that falls along half a cosine.

    ``predict`` gives the present model's photographs [K, H, W, 3] of the samples with the indices [K].
    ``after_epoch(epoch)`` is called after an epoch's steps.
    """
    loader = DataLoader(
        TensorDataset(torch.arange(len(samples.path))),
        batch_size=config.batch,
        shuffle=True,
        generator=torch.Generator().manual_seed(config.seed),
    )
    with quiet_lightning():
        trainer = lightning.Trainer(
            max_epochs=config.epochs,
            accelerator="cpu",
            logger=False,
            enable_checkpointing=False,
            enable_progress_bar=False,
            enable_model_summary=False,
        )
        trainer.fit(_Fit(model, predict, samples, config=config, log=log, after_epoch=after_epoch), loader)


class _Fit(lightning.LightningModule):
    def __init__(
        self,
        model: torch.nn.Module,
        predict: Callable[[Tensor], Tensor],
        samples: StrokeSamples,
        *,
        config: TrainingConfig,
        log: Log,
        after_epoch: Callable[[int], None],
    ) -> None:
        super().__init__()
        self.model, self.predict, self.samples, self.config = model, predict, samples, config
        self.report, self.after_epoch = log, after_epoch
        self.losses: list[float] = []

    def training_step(self, batch: list[Tensor], _: int) -> Tensor:
        loss = weighted_l1(self.predict(batch[0]), self.samples.pick(batch[0]), self.config.ink_weight)
        self.losses.append(float(loss.detach()))
        return loss

    def on_train_epoch_end(self) -> None:
        self.report("weighted_l1", float(np.mean(self.losses)), self.current_epoch)
        self.losses.clear()
        self.after_epoch(self.current_epoch)

    def configure_optimizers(self) -> Any:
        optimizer = torch.optim.Adam(self.model.parameters(), lr=self.config.learning_rate)
        return [optimizer], [torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, self.config.epochs)]
