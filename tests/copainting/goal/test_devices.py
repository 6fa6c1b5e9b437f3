"""Training on two devices (here two processes) equals training on one, up to rounding, and each resumes the other."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from pentimento.contracts.errors import ConfigError
from pentimento.copainting.goal import training
from pentimento.copainting.goal.denoising import GoalTraining, Lora, encode_pairs
from pentimento.copainting.goal.ranks import Log
from pentimento.copainting.goal.training import train_goal_planner
from tests.copainting.goal_planners import TRAINING, Trained, small_pairs, small_planner, trained, uninterrupted

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


def assert_equal_up_to_rounding(one: Trained, other: Trained) -> None:
    assert other.losses == pytest.approx(one.losses, rel=LOSS_TOLERANCE)
    before = Trained(small_planner(), [], []).weights
    assert (other.weights - one.weights).norm() < WEIGHT_TOLERANCE * (one.weights - before).norm()


def test_two_devices_train_as_one_and_resume_each_others_checkpoints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(training, "_train_rank", two_trainings)
    trained(WITH_LORA, tmp_path, until=3)
    two, one = trained(replace(WITH_LORA, devices=2), tmp_path), uninterrupted(WITH_LORA)
    assert_equal_up_to_rounding(
        one, two
    )  # low-rank updates and the text encoder came back to this process, with their averages
    assert two.losses[:2] == one.losses[:2] and two.steps == [2, 3, 4, 5]  # from the checkpoint of one device
    assert two.planner.unet.state_dict().keys() == one.planner.unet.state_dict().keys()
    assert not any(weight.requires_grad for weight in two.planner.unet.parameters())
    assert {path.name for path in tmp_path.iterdir()} == {"step-00000006.ckpt", "whole"}

    (checkpoint,) = (tmp_path / "whole").iterdir()
    assert checkpoint.name == "step-00000004.ckpt"
    resumed = trained(WHOLE_UNET, tmp_path / "whole")
    assert_equal_up_to_rounding(uninterrupted(WHOLE_UNET), resumed)
    assert resumed.steps == [4, 5]  # from the checkpoint of two


def test_rejects_device_counts_that_do_not_fit_batch_or_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ValueError, match="batch is 3, which 2 devices cannot share equally"):
        replace(TRAINING, devices=2)
    with pytest.raises(ValueError, match="devices is 0"):
        replace(TRAINING, devices=0)
    planner, config = small_planner(), replace(WITH_LORA, devices=4, accelerator="auto")
    pairs = encode_pairs(planner, small_pairs(4))
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    with pytest.raises(ConfigError, match="devices is 4, but this machine has 2 GPUs"):
        train_goal_planner(planner, pairs, config, scratch=None, log=lambda *_: None)
