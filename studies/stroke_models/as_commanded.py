"""A tip that is not pressed has no bristles to bend: it goes where it is led, but for an offset.

The thesis's m (5.3.4) moves a mark in proportion to the way from its start: for a brush, what its bristles cut off. A
pen's comes of chance; fitted to short strokes it makes up for half a pixel at their ends, and is millimetres on long
ones.
"""

from __future__ import annotations

import torch

from pentimento.dynamics.strokes.evaluation import predict
from pentimento.dynamics.strokes.samples import StrokeSamples
from pentimento.dynamics.strokes.training import Log, TrainingConfig, descend, first_guess
from pentimento.dynamics.strokes.traj2stroke import Traj2Stroke, Traj2StrokeParameters


def is_pressed(path: torch.Tensor) -> bool:
    """Whether any of commanded paths [B, N, 5] goes below contact."""
    return bool((path[..., 3] < 0).any())


def train_unscaled(samples: StrokeSamples, config: TrainingConfig, log: Log) -> Traj2StrokeParameters:
    """Traj2Stroke, trained as it is alone, but for its scale, which stays 1."""
    torch.manual_seed(config.seed)
    model = Traj2Stroke(first_guess(samples))
    model.scale.requires_grad_(False)
    descend(model, lambda index: predict(model, samples.pick(index)), samples, config=config, log=log)
    return model.parameters_si()
