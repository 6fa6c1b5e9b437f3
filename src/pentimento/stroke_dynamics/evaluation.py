"""How well a stroke model foretells photographs: IoU of the inked pixels, L1 and MSE over sRGB."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from pentimento.stroke_dynamics.samples import StrokeSamples
from pentimento.stroke_dynamics.training import predict, predicted_ink
from pentimento.stroke_dynamics.traj2stroke import Traj2Stroke, Traj2StrokeParameters


@dataclass(frozen=True)
class StrokeScores:
    """Means over strokes."""

    iou: float
    """Intersection over union of inked pixels, strokes without ink left out."""
    l1: float
    """Mean |predicted − measured| over the window, sRGB in [0, 1]."""
    mse: float
    """Mean squared difference over the window, sRGB in [0, 1]."""


def score(predicted: Tensor, samples: StrokeSamples) -> StrokeScores:
    """Scores of predicted photographs [B, H, W, 3]."""
    truth, guess = samples.ink, predicted_ink(samples, predicted)
    union = (truth | guess).flatten(1).sum(1)
    overlap = (truth & guess).flatten(1).sum(1)
    inked = truth.flatten(1).any(1)
    difference = (predicted - samples.after).detach()
    share = samples.valid / samples.valid.sum()
    return StrokeScores(
        iou=float((overlap[inked] / union[inked]).mean()),
        l1=float((difference.abs().mean(-1) * share).sum()),
        mse=float((difference.square().mean(-1) * share).sum()),
    )


def score_model(parameters: Traj2StrokeParameters, samples: StrokeSamples) -> StrokeScores:
    """Scores of a model on measured strokes."""
    with torch.no_grad():
        return score(predict(Traj2Stroke(parameters)(samples.path), samples), samples)
