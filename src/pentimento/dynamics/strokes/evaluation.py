"""Scores of a stroke model's predicted photographs (IoU of inked pixels, L1 and MSE over sRGB), and two baselines.

The baselines are blank paper and a polyline: the commanded path drawn with one width and one opacity, fitted to the
strokes. Every score of a stroke model is reported together with the polyline's.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from scipy.optimize import minimize_scalar
from torch import Tensor

from pentimento.dynamics.strokes.photometry import linear_to_srgb, srgb_to_linear
from pentimento.dynamics.strokes.samples import INK_THRESHOLD, StrokeSamples, inked_share
from pentimento.dynamics.strokes.simulation import StrokeContext, simulate
from pentimento.dynamics.strokes.traj2stroke import Mark, Traj2Stroke, Traj2StrokeParameters


@dataclass(frozen=True)
class StrokeScores:
    """Means over strokes."""

    iou: float
    """Intersection over union of inked pixels, strokes without ink left out."""
    l1: float
    """Mean |predicted − measured| over the window, sRGB in [0, 1]."""
    mse: float
    """Mean squared difference over the window, sRGB in [0, 1]."""


def predict(model: Callable[[Tensor], Mark], samples: StrokeSamples) -> Tensor:
    """The photograph after each stroke, sRGB [B, H, W, 3]: its mark laid over ``before`` in linear light."""
    context = StrokeContext(samples.path[:, None], {})
    color = srgb_to_linear(samples.color)[:, None]
    return linear_to_srgb(simulate(model, (), context, color=color, canvas=samples.before_linear, view=samples.view))


def predicted_ink(samples: StrokeSamples, predicted: Tensor) -> Tensor:
    """Which pixels a prediction [B, H, W, 3] inks, bool [B, H, W], by the same threshold as the measurement."""
    return inked_share(samples.before, predicted.detach(), samples.color[:, None, None]) > INK_THRESHOLD


def weighted_l1(predicted: Tensor, samples: StrokeSamples, ink_weight: float) -> Tensor:
    """Mean absolute difference over sRGB, pixels under the new stroke weighing ``ink_weight`` times (thesis 5.3.4)."""
    weight = samples.valid * torch.where(samples.ink, ink_weight, 1.0)
    return ((predicted - samples.after).abs().mean(-1) * weight).sum() / weight.sum()


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
    """The photographs that a model predicts, sRGB [B, H, W, 3]."""
    with torch.no_grad():
        return predict(Traj2Stroke(parameters), samples)


def score_model(parameters: Traj2StrokeParameters, samples: StrokeSamples) -> StrokeScores:
    """Scores of a model on measured strokes."""
    return score(predict_with(parameters, samples), samples)


HARD_EDGE = 1e-3
"""Softness c of a pen whose mark has a sharp rim."""


def constant_width(half_width_m: float, opacity: float) -> Traj2StrokeParameters:
    """A polyline pen with a hard edge, as parameters of Traj2Stroke."""
    return Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 1e-4, half_width_m, HARD_EDGE, opacity)


def fit_polyline(error: Callable[[Traj2StrokeParameters], float], half_width_m: float = 2e-3) -> Traj2StrokeParameters:
    """The pen with the smallest ``error``.

    Args:
        half_width_m: roughly the pen's. Two decades around its order of magnitude are tried.
    """
    middle = 2e-3 * 10 ** round(math.log10(half_width_m / 2e-3))
    width, opacity = middle, 0.95
    for _ in range(2):  # width and opacity hardly interact: two rounds of line searches settle them
        found = minimize_scalar(
            lambda log_width, o=opacity: error(constant_width(math.exp(log_width), o)),
            bounds=(math.log(middle / 10), math.log(middle * 10)),
            method="bounded",
            options={"xatol": 0.05},
        )
        width = math.exp(found.x)
        found = minimize_scalar(
            lambda o, w=width: error(constant_width(w, o)),
            bounds=(0.3, 0.99),
            method="bounded",
            options={"xatol": 0.05},
        )
        opacity = float(found.x)
    return constant_width(width, opacity)


def blank(samples: StrokeSamples) -> Tensor:
    """The prediction that nothing happens, sRGB [B, H, W, 3]."""
    return torch.clone(samples.before)
