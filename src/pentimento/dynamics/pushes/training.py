"""Training of param2deform on measured pushes, on L_3D + L_viz in the constant pose (thesis 7.3.4)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import lightning
import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader, TensorDataset

from pentimento.contracts.errors import ContractError
from pentimento.contracts.ranges import above_zero, at_least
from pentimento.dynamics.pushes.last_layers import fit_last_layers, losses
from pentimento.dynamics.pushes.measured import PushSamples
from pentimento.dynamics.pushes.param2deform import Param2Deform
from pentimento.dynamics.pushes.pose import Crop, PoseSamples
from pentimento.dynamics.pushes.push_model import PushFacts, PushModel
from pentimento.dynamics.quiet_lightning import quiet_lightning

Log = Callable[[str, float, int], None]

_TOOL_STEPS = 120
"""Steps of the fit of the tool's parameters, which precedes the network's."""
_TOOL_RATE = 0.05
"""Learning rate of the same."""


@dataclass(frozen=True)
class TrainingConfig:
    """Hyper-parameters of param2deform."""

    pixels_per_m: float
    """Finer scans are averaged down, by a whole factor, to about this."""
    side_px: int
    """Side of the constant pose's square, in these pixels."""
    behind_m: float
    """Extent of the square behind the start of a push; a pinch is at its centre."""
    channels: int
    members: int
    """Networks of the ensemble. They differ in their last layer (``last_layers``)."""
    epochs: int
    batch: int
    learning_rate: float
    visual_weight: float
    """Weight of L_viz relative to L_3D, in mm²; 0 trains on L_3D alone."""
    held_out: float
    """Share of the actions held out for the metrics."""
    seed: int

    def __post_init__(self) -> None:
        at_least(self, 1, "channels", "members", "epochs", "batch")
        at_least(self, 8, "side_px")
        at_least(self, 0, "seed", "visual_weight")
        above_zero(self, "pixels_per_m", "behind_m", "learning_rate", "held_out")
        if self.held_out >= 1:
            raise ValueError(f"held_out is {self.held_out}; below 1, some actions are left to train on.")


def crop_for(samples: PushSamples, config: TrainingConfig) -> Crop:
    """The constant pose of a table's pushes; a pinch is at the centre of its square.

    Raises:
        ContractError: the table holds pushes and pinches.
    """
    kinds = sorted(set(samples.kind.tolist()))
    if len(kinds) != 1:
        raise ContractError(f"The pushes table holds {' and '.join(kinds)} rows: train a model for each kind.")
    behind_m = config.behind_m if kinds == ["push"] else config.side_px / samples.pixels_per_m / 2
    return Crop(config.side_px, samples.pixels_per_m, behind_m)


def split_by_action(samples: PushSamples, held_out: float, seed: int) -> tuple[PushSamples, PushSamples]:
    """(training, held-out) samples. Repeats of an action stay together; repeated and single actions are held out in the
    same proportion.

    Raises:
        ContractError: no action is left to train on.
    """
    actions, times = np.unique(samples.action_id, return_counts=True)
    rng = np.random.default_rng(seed)
    shuffled = [rng.permutation(actions[some]) for some in (times > 1, times == 1)]
    held_out_actions = np.concatenate([part[: round(held_out * len(part))] for part in shuffled])
    if not len(held_out_actions):
        held_out_actions = np.concatenate(shuffled)[:1]
    if len(held_out_actions) == len(actions):
        raise ContractError(
            f"Of {len(actions)} actions in the pushes, {len(held_out_actions)} would be held out and none trained on: "
            "record more pushes or lower train_push_dynamics.held_out."
        )
    in_held_out = np.isin(samples.action_id, held_out_actions)
    return samples.pick(~in_held_out), samples.pick(in_held_out)


def loss(difference_m: Tensor, known: Tensor, pixels_per_m: float, *, visual_weight: float) -> Tensor:
    """L_3D + ``visual_weight`` · L_viz, mean over [B, H, W] differences, mm²."""
    return losses(difference_m, known, pixels_per_m, visual_weight=visual_weight).mean()


def train(
    samples: PoseSamples,
    kind: Literal["push", "pinch"],
    contexts: Sequence[tuple[str, str]],
    *,
    crop: Crop,
    config: TrainingConfig,
    log: Log,
) -> PushModel:
    """Fit a network, and the ensemble's last layers to resampled pushes.

    ``log("loss", value, epoch)`` is called after every epoch of the network.
    """
    facts = PushFacts(
        kind, tuple(contexts), crop, config.channels,
        float(samples.length_m.max()), float(samples.depth_m.max()), config.members,
    )  # fmt: skip
    torch.manual_seed(config.seed)
    model = PushModel(facts)
    first, *others = (member for member in model.members if isinstance(member, Param2Deform))
    fit_tool(first, samples, crop, config)
    with quiet_lightning():
        loader = DataLoader(
            TensorDataset(torch.arange(len(samples.state))),
            batch_size=config.batch,
            shuffle=True,
            generator=torch.Generator().manual_seed(config.seed),
        )
        trainer = lightning.Trainer(
            max_epochs=config.epochs,
            accelerator="cpu",
            logger=False,
            enable_checkpointing=False,
            enable_progress_bar=False,
            enable_model_summary=False,
        )
        trainer.fit(_Fit(first, samples, crop, config=config, log=log), loader)
    if others:
        for other in others:
            other.load_state_dict(first.state_dict())
        fit_last_layers((first, *others), samples, crop, visual_weight=config.visual_weight, seed=config.seed)
    return model.eval()


def fit_tool(network: Param2Deform, samples: PoseSamples, crop: Crop, config: TrainingConfig) -> None:
    """Fit the tool's parameters alone, so that the network learns only what geometry does not explain."""
    network.tool.data[:, 4] = 0.5
    tool_parameters = [network.tool] if network.apart is None else [network.tool, network.apart]
    optimizer = torch.optim.Adam(tool_parameters, lr=_TOOL_RATE)
    generator = torch.Generator().manual_seed(config.seed)
    for _ in range(_TOOL_STEPS):
        some = samples.pick(torch.randperm(len(samples.state), generator=generator)[: 2 * config.batch])
        optimizer.zero_grad()
        pressed = network.pressed(some.state, some.length_m, some.depth_m, some.context)
        torch.autograd.backward(loss(pressed - some.change, some.known, crop.pixels_per_m, visual_weight=0.0))
        optimizer.step()


class _Fit(lightning.LightningModule):
    def __init__(
        self,
        network: Param2Deform,
        samples: PoseSamples,
        crop: Crop,
        *,
        config: TrainingConfig,
        log: Log,
    ) -> None:
        super().__init__()
        self.network, self.samples, self.crop, self.config = network, samples, crop, config
        self.mirrors = torch.Generator().manual_seed(config.seed)
        self.report = log
        self.losses: list[float] = []

    def training_step(self, batch: list[Tensor], _: int) -> Tensor:
        some = self.samples.pick(batch[0])
        some = some.mirrored(torch.rand(len(some.state), generator=self.mirrors) < 0.5)
        change = self.network(some.state, some.length_m, some.depth_m, some.context)
        value = loss(change - some.change, some.known, self.crop.pixels_per_m, visual_weight=self.config.visual_weight)
        self.losses.append(float(value.detach()))
        return value

    def on_train_epoch_end(self) -> None:
        self.report("loss", float(np.mean(self.losses)), self.current_epoch)
        self.losses.clear()

    def configure_optimizers(self) -> Any:
        optimizer = torch.optim.Adam(self.network.parameters(), lr=self.config.learning_rate)
        return [optimizer], [torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, self.config.epochs)]
