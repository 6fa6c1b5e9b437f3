"""Training on two devices, here two processes: it is the training on one, up to rounding, and each can take over."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import pytest
import torch

from pentimento.contracts.errors import ConfigError
from pentimento.copainting.goal import training
from pentimento.copainting.goal.denoising import GoalTraining, Lora, encode_pairs
from pentimento.copainting.goal.planner import GoalPlanner
from pentimento.copainting.goal.ranks import Log
from pentimento.copainting.goal.training import train_goal_planner
from tests.copainting.goal_planners import TRAINING, small_pairs, small_planner

# Losses are means of float32, added in another order: 1e-5 was measured after some steps. AdamW divides a gradient by
# its own size, so that where rounding is all of it (a bias before a norm), a step may go either way. Weights are
# therefore compared as a whole with what training changed: 0.006 was measured.
LOSS_TOLERANCE, WEIGHT_TOLERANCE = 1e-4, 0.03
WITH_LORA = replace(TRAINING, batch=4, drop_text=0.2, drop_image=0.2, drop_both=0.2, lora=Lora(2, 4))
WHOLE_UNET = replace(WITH_LORA, lora=None, checkpoint_every=4)

_train_rank = training._train_rank


def two_trainings(rank: int, folder: Path, config: GoalTraining, scratch: Path, log: Log) -> None:
    """Because processes take long to start: one training of the whole UNet before the one that was asked for."""
    _train_rank(rank, folder, replace(WHOLE_UNET, devices=2), scratch / "whole", lambda *_: None)
    _train_rank(rank, folder, config, scratch, log)


class Killed(Exception):
    pass


class Trained(NamedTuple):
    """What is left of a training."""

    planner: GoalPlanner
    losses: list[float]
    told: list[int]
    """The steps that were logged, in that order."""


def trained(config: GoalTraining, scratch: Path | None, until: int | None = None) -> Trained:
    """A small planner after training; killed at step `until`."""
    torch.set_num_threads(1)
    after = Trained(small_planner(), [], [])

    def log(_name: str, _value: float, step: int) -> None:
        after.told.append(step)
        if step == until:
            raise Killed

    pairs = encode_pairs(after.planner, small_pairs(7))
    try:
        after.losses.extend(train_goal_planner(after.planner, pairs, config, scratch, log))
    except Killed:
        assert until is not None
    return after


def weights(planner: GoalPlanner) -> torch.Tensor:
    parts = (planner.unet, planner.text_encoder)
    return torch.cat([weight.detach().flatten() for part in parts for weight in part.parameters()])


def assert_alike(one: Trained, other: Trained) -> None:
    assert other.losses == pytest.approx(one.losses, rel=LOSS_TOLERANCE)
    before, first, second = (weights(planner) for planner in (small_planner(), one.planner, other.planner))
    assert (second - first).norm() < WEIGHT_TOLERANCE * (first - before).norm()


def test_two_devices_train_as_one_and_resume_each_others_checkpoints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(training, "_train_rank", two_trainings)
    trained(WITH_LORA, tmp_path, until=3)
    two, one = trained(replace(WITH_LORA, devices=2), tmp_path), trained(WITH_LORA, None)
    assert_alike(one, two)  # low-rank updates and the text encoder came back to this process, with their averages
    assert two.losses[:2] == one.losses[:2] and two.told == [2, 3, 4, 5]  # from the checkpoint of one device
    assert two.planner.unet.state_dict().keys() == one.planner.unet.state_dict().keys()
    assert not any(weight.requires_grad for weight in two.planner.unet.parameters())
    assert {path.name for path in tmp_path.iterdir()} == {"step-00000006.ckpt", "whole"}

    (checkpoint,) = (tmp_path / "whole").iterdir()
    assert checkpoint.name == "step-00000004.ckpt"
    resumed = trained(WHOLE_UNET, tmp_path / "whole")
    assert_alike(trained(WHOLE_UNET, None), resumed)
    assert resumed.told == [4, 5]  # from the checkpoint of two


def test_rejects_device_counts_that_do_not_fit_batch_or_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ValueError, match="batch is 3, which 2 devices cannot share equally"):
        replace(TRAINING, devices=2)
    with pytest.raises(ValueError, match="devices is 0"):
        replace(TRAINING, devices=0)
    planner, config = small_planner(), replace(WITH_LORA, devices=4, accelerator="auto")
    pairs = encode_pairs(planner, small_pairs(4))
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    with pytest.raises(ConfigError, match="devices is 4, but this machine has 2 GPUs"):
        train_goal_planner(planner, pairs, config, None, lambda *_: None)
