"""Fit of the learned correction, and the decision how much of it a tool gets, by cross-fitting."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.stats import ttest_1samp
from torch import Tensor

from pentimento.dynamics.strokes.correction import MarkCorrection, is_turned
from pentimento.dynamics.strokes.extended import MeasuredStrokes, StrokeModel, predict_extended, predict_strokes
from pentimento.dynamics.strokes.samples import StrokeSamples
from pentimento.dynamics.strokes.simulation import executed_path, final_mark
from pentimento.dynamics.strokes.training import Log, TrainingConfig, descend

_FOLDS = 4
_SHARES = (0.25, 0.5, 0.75, 1.0)
_FEWEST_ACTIONS = 40
"""With fewer, the held-out actions cannot tell a gain from chance."""
_LARGEST_P = 0.05
"""One-sided p of the gain on held-out actions, above which a tool gets no correction."""
_EPOCHS, _RATE = 40, 3e-3
_LEAST_PRESS_M = 1e-5
"""Unit of press for a tool that is never pressed."""


@dataclass(frozen=True)
class CorrectionFit:
    """Result of a fit."""

    model: StrokeModel
    """The model with its correction; as it was where held-out actions gain nothing."""
    share: float
    """Share of the network's output that is applied; 0 without a correction."""
    held_out_l1: tuple[float, float]
    """Weighted L1 of the model, and with corrections that were fitted to other actions, that share of them applied."""


def fit_correction(model: StrokeModel, strokes: MeasuredStrokes, *, config: TrainingConfig, log: Log) -> CorrectionFit:
    """Fit a correction of the model's marks to strokes, with the model frozen.

    Args:
        model: without a correction.
        strokes: to fit to.
        config: of which the batch, the weight of ink and the seed are used.
        log: gets ``correction_weighted_l1`` of the last fit.
    """
    samples = strokes.samples
    config = replace(config, epochs=_EPOCHS, learning_rate=_RATE)
    before = _weighted_errors(predict_strokes(model, strokes), samples, config.ink_weight)
    all_weight = float(_weights(samples, config.ink_weight).sum())
    l1 = float(before.sum()) / all_weight
    actions, number = np.unique(samples.action.numpy(), return_inverse=True)
    none = CorrectionFit(model, 0.0, (l1, l1))
    if len(actions) < _FEWEST_ACTIONS:
        return none
    fold = (np.random.default_rng([config.seed, 7]).permutation(len(actions)) % _FOLDS)[number]
    after = {share: before.clone() for share in _SHARES}
    for k in range(_FOLDS):
        known, held_out = (strokes.pick(torch.from_numpy(np.flatnonzero(part))) for part in (fold != k, fold == k))
        correction = _fitted(model, known, config, _quiet)
        for share, errors in after.items():
            correction.share = share
            predicted = predict_strokes(replace(model, correction=correction), held_out)
            errors[torch.from_numpy(fold == k)] = _weighted_errors(predicted, held_out.samples, config.ink_weight)
    share = min(after, key=lambda s: float(after[s].sum()))
    gains = np.bincount(number, (before - after[share]).double().numpy())
    if ttest_1samp(gains, 0.0, alternative="greater").pvalue > _LARGEST_P:
        return none
    correction = _fitted(model, strokes, config, log)
    correction.share = share
    corrected = replace(model, correction=correction)
    return CorrectionFit(corrected, share, (l1, float(after[share].sum()) / all_weight))


def _fitted(model: StrokeModel, strokes: MeasuredStrokes, config: TrainingConfig, log: Log) -> MarkCorrection:
    base, mechanisms, context = model.mark(), model.mechanisms, strokes.context
    mark, path = final_mark(base, mechanisms, context), executed_path(mechanisms, context)
    press = float((-path[..., 3]).clamp(min=0.0).mean())
    torch.manual_seed(config.seed)
    correction = MarkCorrection(
        half_width_m=float(mark.radius_m.mean()), press_m=max(press, _LEAST_PRESS_M), turned=is_turned(path[:, 0])
    )
    correction.calibrate(mark, path)

    def predict(index: Tensor) -> Tensor:
        return predict_extended(base, mechanisms, strokes.pick(index), correction)

    def report(_: str, value: float, epoch: int) -> None:
        log("correction_weighted_l1", value, epoch)

    descend(correction, predict, strokes.samples, config=config, log=report)
    return correction.requires_grad_(False).eval()


def _weights(samples: StrokeSamples, ink_weight: float) -> Tensor:
    """Weights of pixels, [B, H, W] (thesis 5.3.4)."""
    return samples.valid * torch.where(samples.ink, ink_weight, 1.0)


def _weighted_errors(predicted: Tensor, samples: StrokeSamples, ink_weight: float) -> Tensor:
    """Weighted sum of each stroke's absolute errors, [B]."""
    off = (predicted - samples.after).abs().mean(-1)
    return (off * _weights(samples, ink_weight)).flatten(1).sum(1)


def _quiet(name: str, value: float, step: int) -> None:
    """Fits of folds are not reported."""
