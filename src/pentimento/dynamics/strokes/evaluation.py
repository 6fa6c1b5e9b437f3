"""How well a stroke model foretells photographs: IoU of the inked pixels, L1 and MSE over sRGB."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from pentimento.dynamics.strokes.samples import StrokeSamples
from pentimento.dynamics.strokes.training import predict, predicted_ink
from pentimento.dynamics.strokes.traj2stroke import Traj2Stroke, Traj2StrokeParameters


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
    difference = (predicted - samples.after).abs().mean(-1)
    share = samples.valid / samples.valid.sum()
    return StrokeScores(
        iou=mean_iou(predicted, samples),
        l1=float((difference * share).sum()),
        mse=mean_squared_error(predicted, samples),
    )


def mean_iou(predicted: Tensor, samples: StrokeSamples) -> float:
    """Mean intersection over union of inked pixels; strokes without ink are left out."""
    guess = predicted_ink(samples, predicted)
    union = (samples.ink | guess).flatten(1).sum(1)
    overlap = (samples.ink & guess).flatten(1).sum(1)
    inked = samples.ink.flatten(1).any(1)
    return float((overlap[inked] / union[inked]).mean())


def mean_squared_error(predicted: Tensor, samples: StrokeSamples) -> float:
    """Mean squared difference over the windows, sRGB in [0, 1]."""
    share = samples.valid / samples.valid.sum()
    return float(((predicted - samples.after).square().mean(-1) * share).sum())


def predict_with(parameters: Traj2StrokeParameters, samples: StrokeSamples) -> Tensor:
    """The photographs that a model foretells, sRGB [B, H, W, 3]."""
    with torch.no_grad():
        return predict(Traj2Stroke(parameters), samples)


def score_model(parameters: Traj2StrokeParameters, samples: StrokeSamples) -> StrokeScores:
    """Scores of a model on measured strokes."""
    return score(predict_with(parameters, samples), samples)
