"""Soft-edge model: a residual network beside a stroke model, in the stroke's own coordinates.

For each pixel a small network gets features of its place relative to the predicted mark (``about_path``). It predicts
how much more or less paint is there, in units that depend on the distance to the mark's edge. Each pixel is one
example, so that few strokes suffice. The model is cross-fitted (Chernozhukov et al. 2018): networks are evaluated on
strokes that they were not trained on, and weighted by the factor that predicts these best (stacking; Wolpert 1992).
Where the factor is 0, the stroke model is used alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from pentimento.dynamics.strokes.extended import MeasuredStrokes, StrokeModel, predict_extended
from pentimento.dynamics.strokes.samples import inked_share
from pentimento.dynamics.strokes.simulation import extended_mark, full_at_most
from pentimento.dynamics.strokes.training import Log
from pentimento.dynamics.strokes.traj2stroke import Mark
from studies.stroke_models.networks.about_path import NAMES, about_path, odd

_FOLDS = 3
_MIN_ACTIONS = 50
"""With fewer, the held-out actions cannot distinguish a gain from chance."""
_WIDTH, _LAYERS = 64, 3
_STEPS, _STEPS_OF_A_FOLD = 1000, 600
_PIXELS, _PIXELS_OF_A_FOLD = 4096, 2048
"""Whether networks are to be believed shows early; seen for long, few strokes are learnt by heart."""
_RATE, _DECAY = 3e-3, 1e-4
_SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Weights to choose from."""
_STEEP, _FARTHEST = 4.0, 8.0
"""By how much more must be said for each half-width that a pixel lies further out of the mark, and at most."""
_DISTANCE, _HALF_WIDTH = (NAMES.index(name) for name in ("distance", "half-width"))
_SMALLEST = 1e-9
_REPORTED = 100


@dataclass(frozen=True)
class SoftEdgeModel:
    """A stroke model with its causes, unchanged, and the network beside it."""

    model: StrokeModel
    network: _Network | None
    """None where networks do not improve the prediction of held-out strokes."""
    believed: float
    """Weight of the network."""
    unseen_l1: tuple[float, float]
    """Weighted L1 of the training strokes: by the model alone, and beside networks that learnt from others, believed by
    that share."""

    def __call__(self, strokes: MeasuredStrokes) -> Tensor:
        """The photographs after strokes, sRGB [B, H, W, 3]."""
        pixels = _pixels_of(self.model, strokes)
        with torch.no_grad():
            predicted = pixels.predicted if self.network is None else self.network(pixels, self.believed)
        return predicted.view(strokes.samples.after.shape)


def fit_soft_edge(
    model: StrokeModel, strokes: MeasuredStrokes, ink_weight: float, seed: int, log: Log
) -> SoftEdgeModel:
    """Lower the weighted L1 (thesis 5.3.4) of a model's strokes, by pixels drawn at random.

    ``log`` gets ``weighted_l1`` of the pixels of some steps.
    """
    samples = strokes.samples
    pixels, after = _pixels_of(model, strokes), samples.after.reshape(-1, 3)
    weight = (samples.valid * torch.where(samples.ink, ink_weight, 1.0)).flatten()
    fold = _folds(samples.action, seed).repeat_interleave(samples.valid[0].numel())

    def learnt(known: Tensor, number: int, steps: int, batch: int) -> _Network:
        torch.manual_seed(seed * (_FOLDS + 1) + number)
        known = known & (weight > 0)
        network = _Network(pixels.features[known])
        _descend(network, pixels.pick(known), after[known], weight=weight[known], steps=steps, batch=batch, log=log)
        return network.eval()

    def weighted_l1(predicted: Tensor) -> float:
        return float(((predicted - after).abs().mean(-1) * weight).sum() / weight.sum())

    unseen = {share: pixels.predicted.clone() for share in _SHARES}
    for number in range(_FOLDS if len(set(samples.action.tolist())) >= _MIN_ACTIONS else 0):
        network, out = learnt(fold != number, number, _STEPS_OF_A_FOLD, _PIXELS_OF_A_FOLD), fold == number
        with torch.no_grad():
            for share, predicted in unseen.items():
                predicted[out] = network(pixels.pick(out), share)
    errors = {share: weighted_l1(predicted) for share, predicted in unseen.items()}
    believed = min(errors, key=lambda share: errors[share])
    network_of_all = learnt(fold >= 0, _FOLDS, _STEPS, _PIXELS) if believed > 0 else None
    return SoftEdgeModel(model, network_of_all, believed, (errors[0.0], errors[believed]))


class _Pixels(NamedTuple):
    """Pixels of all strokes, in a row."""

    features: Tensor  # [n, F]
    predicted: Tensor  # [n, 3] sRGB, by the model alone
    share: Tensor  # [n] of the way from what was there to the paint that this is
    towards: Tensor  # [n, 3] the whole way, sRGB
    inside: Tensor  # [n] half-widths from the mark's edge: 1 on the path, 0 at the edge, negative beyond

    def pick(self, index: Tensor) -> _Pixels:
        return _Pixels(*(field[index] for field in self))


def _pixels_of(model: StrokeModel, strokes: MeasuredStrokes) -> _Pixels:
    samples, base = strokes.samples, model.mark()
    with torch.no_grad():
        predicted = predict_extended(base, model.mechanisms, strokes)
        mark = full_at_most(extended_mark(base, model.mechanisms, strokes.context))
        features = about_path(Mark(*(values[:, 0] for values in mark)), samples)
    color = samples.color[:, None, None]
    share = inked_share(samples.before, predicted, color).clamp(0.0, 1.0)
    features = features.flatten(0, 2)
    inside = 1 - features[:, _DISTANCE] / features[:, _HALF_WIDTH]
    return _Pixels(features, predicted.reshape(-1, 3), share.flatten(), (color - samples.before).reshape(-1, 3), inside)


class _Network(nn.Module):
    """Predicts pixels. It is symmetric under the mirror; untrained, it gives the stroke model's prediction.

    Features are clamped to the range of those [n, F] that it was trained on.
    """

    def __init__(self, features: Tensor) -> None:
        super().__init__()
        sign = odd()
        mean = torch.where(sign < 0, 0.0, features.mean(0))
        spread = features.std(0).clamp(min=_SMALLEST)
        high, low = ((extreme - mean) / spread for extreme in (features.amax(0), features.amin(0)))
        either = torch.maximum(high, -low)
        self.sign, self.mean, self.spread = sign, mean, spread
        self.low, self.high = torch.where(sign < 0, -either, low), torch.where(sign < 0, either, high)
        layers: list[nn.Module] = []
        for before in (features.shape[1], *[_WIDTH] * (_LAYERS - 1)):
            layers += [nn.Linear(before, _WIDTH), nn.SiLU()]
        last = nn.Linear(_WIDTH, 1)
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        self.layers = nn.Sequential(*layers, last)

    def forward(self, pixels: _Pixels, believed: float = 1.0) -> Tensor:
        """Photographed, sRGB [n, 3]. In training each pixel is seen on one side of the mirror, by chance."""
        seen = ((pixels.features - self.mean) / self.spread).clamp(self.low, self.high)
        if self.training:
            said = self.layers(torch.where(torch.rand(len(seen), 1) < 0.5, seen, seen * self.sign))
        else:
            said = (self.layers(seen) + self.layers(seen * self.sign)) / 2
        start = (_STEEP * pixels.inside).clamp(min=-_FARTHEST)
        now, then = torch.sigmoid(start), torch.sigmoid(start + believed * said[:, 0])
        more, less = (1 - pixels.share) * (then - now) / (1 - now), pixels.share * (then - now) / now
        return pixels.predicted + torch.where(then > now, more, less)[:, None] * pixels.towards


def _descend(
    network: _Network, pixels: _Pixels, after: Tensor, *, weight: Tensor, steps: int, batch: int, log: Log
) -> None:
    """AdamW (Loshchilov & Hutter 2019), its rate up and down in one cycle, on pixels drawn with replacement."""
    optimiser = torch.optim.AdamW(network.parameters(), lr=_RATE, weight_decay=_DECAY)
    rate = torch.optim.lr_scheduler.OneCycleLR(optimiser, _RATE, total_steps=steps, pct_start=0.1)
    for step in range(steps):
        some = torch.randint(0, len(after), (batch,))
        off = (network(pixels.pick(some)) - after[some]).abs().mean(-1)
        loss = (weight[some] * off).sum() / weight[some].sum()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        rate.step()
        if (step + 1) % _REPORTED == 0:
            log("weighted_l1", float(loss.detach()), step)


def _folds(action: Tensor, seed: int) -> Tensor:
    """Of each stroke the fold that its action is in, [B]; repeats of an action stay together."""
    _, number = torch.unique(action, return_inverse=True)
    drawn = np.random.default_rng([seed, 21]).permutation(int(number.max()) + 1) % _FOLDS
    return torch.from_numpy(drawn)[number]
