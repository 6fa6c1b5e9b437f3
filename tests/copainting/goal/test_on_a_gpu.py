"""Training on a GPU equals training on the CPU, up to rounding, and each resumes the other."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from pentimento.copainting.goal.denoising import GoalTraining, Lora
from tests.copainting.goal_planners import TRAINING, Trained, small_planner, trained, uninterrupted

pytestmark = pytest.mark.skipif(
    not torch.cuda.is_available(), reason="no CUDA device: training the goal planner on a GPU is NOT tested"
)
ON_GPU = replace(TRAINING, accelerator="auto")


def assert_equal_up_to_rounding(one: Trained, expected: Trained, loss: float = 1e-3, weights: float = 0.05) -> None:
    assert one.losses == pytest.approx(expected.losses, rel=loss)
    change = expected.weights - Trained(small_planner(), [], []).weights
    assert (one.weights - expected.weights).norm() <= weights * change.norm()


@pytest.mark.parametrize("lora", [None, Lora(2, 4)])
@pytest.mark.parametrize("precision", ["32-true", "bf16-mixed", "16-mixed"])
def test_training_on_a_gpu_equals_training_on_the_cpu(lora: Lora | None, precision: str) -> None:
    loss, weights = (1e-3, 0.05) if precision == "32-true" else (0.05, 0.5)
    result = trained(replace(ON_GPU, lora=lora, precision=precision))
    assert all(weight.device.type == "cpu" for weight in result.planner.unet.parameters())
    assert_equal_up_to_rounding(result, uninterrupted(replace(TRAINING, lora=lora)), loss, weights)


@pytest.mark.parametrize("first", [TRAINING, ON_GPU])
def test_killed_training_resumes_on_a_gpu(first: GoalTraining, tmp_path: Path) -> None:
    trained(first, tmp_path, until=3)
    assert_equal_up_to_rounding(trained(ON_GPU, tmp_path), uninterrupted(ON_GPU))


def test_training_in_a_child_process_on_a_gpu_gives_the_same_weights(tmp_path: Path) -> None:
    assert_equal_up_to_rounding(trained(replace(ON_GPU, strategy="ddp"), tmp_path), uninterrupted(ON_GPU))
