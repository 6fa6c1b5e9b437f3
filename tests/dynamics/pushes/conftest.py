"""A small trained push model and its data."""

from typing import NamedTuple

import pytest

from pentimento.contracts.pushes import example_table
from pentimento.dynamics.pushes.measured import PushSamples, load_pushes
from pentimento.dynamics.pushes.pose import Crop, in_pose
from pentimento.dynamics.pushes.push_model import PushModel
from pentimento.dynamics.pushes.training import TrainingConfig, crop_for, split_by_action, train

CONFIG = TrainingConfig(
    pixels_per_m=640,
    side_px=40, behind_m=0.03, channels=8, members=2, epochs=10, batch=8, learning_rate=4e-3, visual_weight=1.0,
    held_out=0.25, seed=0,
)  # fmt: skip


class Trained(NamedTuple):
    model: PushModel
    crop: Crop
    training: PushSamples
    held_out: PushSamples
    losses: list[float]


@pytest.fixture(scope="session")
def trained() -> Trained:
    samples, _ = load_pushes(example_table(56))
    training, held_out = split_by_action(samples, CONFIG.held_out, CONFIG.seed)
    crop = crop_for(samples, CONFIG)
    losses: list[float] = []
    contexts = [("foam", "ball")]
    model = train(
        in_pose(training, crop),
        "push",
        contexts,
        crop=crop,
        config=CONFIG,
        log=lambda name, value, step: losses.append(value),
    )
    return Trained(model, crop, training, held_out, losses)
