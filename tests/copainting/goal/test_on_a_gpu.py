"""Training on a GPU is the training on the CPU, up to rounding, and goes on where either stopped."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from pentimento.copainting.goal.denoising import GoalTraining, Lora, encode_pairs
from pentimento.copainting.goal.planner import GoalPlanner
from pentimento.copainting.goal.training import train_goal_planner
from tests.copainting.goal_planners import TRAINING, small_pairs, small_planner

pytestmark = pytest.mark.skipif(
    not torch.cuda.is_available(), reason="no CUDA device: training the goal planner on a GPU is NOT tested"
)
ON_GPU = replace(TRAINING, accelerator="auto")


class Killed(Exception):
    pass


def trained(
    config: GoalTraining, scratch: Path | None = None, until: int | None = None
) -> tuple[GoalPlanner, list[float]]:
    """A small planner after training, and its losses; killed at step `until`."""
    planner = small_planner()

    def log(_name: str, _value: float, step: int) -> None:
        if step == until:
            raise Killed

    try:
        return planner, train_goal_planner(planner, encode_pairs(planner, small_pairs(7)), config, scratch, log)
    except Killed:
        return planner, []


def change(planner: GoalPlanner) -> torch.Tensor:
    """What training changed, all weights in a row."""
    rows = []
    for part in ("unet", "text_encoder"):
        before, after = (getattr(one, part).state_dict() for one in (small_planner(), planner))
        rows += [(after[name] - weight).flatten() for name, weight in before.items()]
    return torch.cat(rows)


@pytest.mark.parametrize("lora", [None, Lora(2, 4)])
@pytest.mark.parametrize(("precision", "tolerance"), [("32-true", 0.05), ("bf16-mixed", 0.5), ("16-mixed", 0.5)])
def test_training_on_a_gpu_equals_training_on_the_cpu(lora: Lora | None, precision: str, tolerance: float) -> None:
    config = replace(ON_GPU, lora=lora, precision=precision)
    (ours, losses), (wanted, expected) = trained(config), trained(replace(TRAINING, lora=lora))
    assert all(weight.device.type == "cpu" for weight in ours.unet.parameters())
    assert losses == pytest.approx(expected, rel=1e-3 if precision == "32-true" else 0.05)
    theirs = change(wanted)
    assert (change(ours) - theirs).norm() <= tolerance * theirs.norm()


@pytest.mark.parametrize("first", [TRAINING, ON_GPU])
def test_killed_training_resumes_on_a_gpu(first: GoalTraining, tmp_path: Path) -> None:
    trained(first, tmp_path, until=3)
    planner, losses = trained(ON_GPU, tmp_path)
    whole, expected = trained(ON_GPU)
    assert losses == pytest.approx(expected, rel=1e-3)
    assert (change(planner) - change(whole)).norm() <= 0.05 * change(whole).norm()


def test_training_in_a_child_process_on_a_gpu_gives_the_same_weights(tmp_path: Path) -> None:
    planner, losses = trained(replace(ON_GPU, strategy="ddp"), tmp_path)
    whole, expected = trained(ON_GPU)
    assert losses == pytest.approx(expected, rel=1e-3)
    assert (change(planner) - change(whole)).norm() <= 0.05 * change(whole).norm()
