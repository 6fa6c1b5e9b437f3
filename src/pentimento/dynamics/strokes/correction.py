"""Learned correction of a mark: what a tool does in every stroke beyond the stroke model and its causes.

A small network moves each point of the mark, and changes its radius, density and softness. Its inputs are geometry
alone: position along the stroke, press, turns, and how a turned tool lies to its heading. Place, order, time and other
covariates of causes are no inputs, so that it cannot take the place of a cause; it is fitted after the diagnosis, with
the causes frozen. A mirrored stroke gets the mirrored correction.

The corrected mark is rendered by the same kernel, and its gradient is exact. Whether a tool gets a correction, and how
much of it, is decided by actions that it was not trained on (cross-fitting).
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor, nn

from pentimento.contracts.codec import from_plain
from pentimento.contracts.errors import ContractError
from pentimento.dynamics.strokes.traj2stroke import Mark

TURNED_RAD = 0.2
"""Standard deviation of a tool's yaw from which the tool's lie is an input."""
_WIDTH = 24
_SHORT, _LONG = 1.5, 6.0
"""Distances to the ends that inputs resolve, in half-widths."""
_NEAREST_M = 1e-7
"""Floor under the distance of two points."""
_SHARPEST = 1e-3
"""Floor under 1 + cos of a turn: a full reversal has no tangent of its half."""
_FAINTEST = 1e-4
"""Distance of a density from 0 and 1."""
_LARGEST = (1.0, 2.0, 1.2, 3.0, 2.0)
"""Largest corrections: across and along in half-widths, log radius, logit of density, log softness."""
_SMALLEST_SPREAD = 1e-3
_EVEN, _ODD = 11, 3
"""Numbers of inputs that a mirror keeps, and whose sign it changes."""


class Inputs(NamedTuple):
    """Inputs of the network at each point of marks [..., N]."""

    even: Tensor
    """[..., N, E]: a mirrored stroke has the same."""
    odd: Tensor
    """[..., N, O]: a mirrored stroke has the opposite."""
    tangent: Tensor
    """[..., N, 2]: unit vectors along the mark; no input."""


@dataclass(frozen=True)
class CorrectionParameters:
    """Content of ``correction.json``. Lists of lists are matrices by rows."""

    half_width_m: float
    """Unit of lengths: the mean half-width of the marks that it was fitted to."""
    press_m: float
    """Unit of press: their mean."""
    turned: bool
    """Whether the tool's lie is an input."""
    share: float
    """Share of the network's output that is applied, 0 to 1."""
    mean: tuple[float, ...]
    spread: tuple[float, ...]
    low: tuple[float, ...]
    """Inputs below the fitted range are held at its end, in units of ``spread`` from ``mean``."""
    high: tuple[float, ...]
    weights: tuple[tuple[tuple[float, ...], ...], ...]
    biases: tuple[tuple[float, ...], ...]


class MarkCorrection(nn.Module):
    """The correction as a function of a mark and the path that was executed; differentiable in both."""

    mean: Tensor
    spread: Tensor
    low: Tensor
    high: Tensor
    sign: Tensor
    """-1 for inputs whose sign a mirror changes."""
    largest: Tensor
    across: Tensor
    """-1 for the output whose sign a mirror changes."""

    def __init__(self, *, half_width_m: float, press_m: float, turned: bool, share: float = 1.0) -> None:
        super().__init__()
        self.half_width_m, self.press_m, self.turned, self.share = half_width_m, press_m, turned, share
        count = _EVEN + _ODD + 2 * turned
        last = nn.Linear(_WIDTH, len(_LARGEST))
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        self.network = nn.Sequential(
            nn.Linear(count, _WIDTH), nn.SiLU(), nn.Linear(_WIDTH, _WIDTH), nn.SiLU(), last
        )  # fmt: skip
        for name, value in (("mean", 0.0), ("spread", 1.0), ("low", -1e6), ("high", 1e6)):
            self.register_buffer(name, torch.full((count,), value))
        odd = _ODD + turned
        self.register_buffer("sign", torch.tensor([1.0] * (count - odd) + [-1.0] * odd))
        self.register_buffer("largest", torch.tensor(_LARGEST))
        self.register_buffer("across", torch.tensor([-1.0, 1.0, 1.0, 1.0, 1.0]))

    def calibrate(self, mark: Mark, path: Tensor) -> None:
        """Take mean, spread and range of the inputs from the marks of all strokes that are fitted."""
        inputs = self.inputs(mark, path)
        values = torch.cat([inputs.even, inputs.odd], dim=-1).flatten(0, -2).detach()
        symmetric = self.sign < 0
        self.mean = torch.where(symmetric, 0.0, values.mean(0))
        self.spread = values.std(0).clamp(min=_SMALLEST_SPREAD)
        low, high = ((extreme - self.mean) / self.spread for extreme in (values.amin(0), values.amax(0)))
        either = torch.maximum(high, -low)
        self.low, self.high = torch.where(symmetric, -either, low), torch.where(symmetric, either, high)

    def inputs(self, mark: Mark, path: Tensor) -> Inputs:
        """Inputs for marks with points [..., N, 2] of executed paths [..., N, 5]."""
        step = mark.points_m.diff(dim=-2)
        length = step.norm(dim=-1).clamp(min=_NEAREST_M)
        start = torch.zeros_like(length[..., :1])
        arc = torch.cat([start, length.cumsum(-1)], dim=-1) / self.half_width_m
        whole = arc[..., -1:].expand_as(arc)
        chord = torch.cat([step[..., :1, :], step[..., 1:, :] + step[..., :-1, :], step[..., -1:, :]], dim=-2)
        tangent = chord / chord.norm(dim=-1, keepdim=True).clamp(min=_NEAREST_M)
        before, after = tangent[..., :-1, :], tangent[..., 1:, :]
        cross = before[..., 0] * after[..., 1] - before[..., 1] * after[..., 0]
        turn = 2 * (cross / (1 + (before * after).sum(-1)).clamp(min=_SHARPEST)).atan()
        turned = torch.cat([start, turn.cumsum(-1)], dim=-1)
        bend = torch.tanh(2 * self.half_width_m * torch.cat([start, turn / length], dim=-1))
        press = (-path[..., 3]).clamp(min=0.0) / self.press_m
        slope = torch.cat([press.diff(dim=-1) / length * self.half_width_m, start], dim=-1)
        to_end = whole - arc
        even = [
            press, press.mean(-1, keepdim=True).expand_as(press), press[..., :1].expand_as(press),
            press[..., -1:].expand_as(press), torch.tanh(4 * slope), torch.tanh(arc / _SHORT), torch.tanh(arc / _LONG),
            torch.tanh(to_end / _SHORT), torch.tanh(to_end / _LONG), arc / whole, whole.log(),
        ]  # fmt: skip
        odd = [bend, turned, turned[..., -1:] - turned]
        if self.turned:
            twice = torch.stack([(2 * path[..., 4]).cos(), (2 * path[..., 4]).sin()], dim=-1)
            x, y = tangent.unbind(-1)
            cosine, sine = x * x - y * y, 2 * x * y
            even.append(cosine * twice[..., 0] + sine * twice[..., 1])
            odd.append(sine * twice[..., 0] - cosine * twice[..., 1])
        return Inputs(torch.stack(even, dim=-1), torch.stack(odd, dim=-1), tangent)

    def forward(self, mark: Mark, path: Tensor) -> Mark:
        """The corrected mark."""
        inputs = self.inputs(mark, path)
        values = (torch.cat([inputs.even, inputs.odd], dim=-1) - self.mean) / self.spread
        values = torch.minimum(torch.maximum(values, self.low), self.high)
        found = (self.network(values) + self.across * self.network(values * self.sign)) / 2
        across, along, radius, density, softness = (
            self.share * self.largest * torch.tanh(found / self.largest)
        ).unbind(-1)
        normal = torch.stack([-inputs.tangent[..., 1], inputs.tangent[..., 0]], dim=-1)
        moved = across[..., None] * normal + along[..., None] * inputs.tangent
        logit = torch.logit(mark.density.clamp(_FAINTEST, 1 - _FAINTEST)) + density
        return Mark(
            mark.points_m + self.half_width_m * moved,
            mark.radius_m * radius.exp(),
            torch.sigmoid(logit),
            mark.softness * softness.exp(),
        )

    def parameters_si(self) -> CorrectionParameters:
        """The correction as numbers."""
        linear = [layer for layer in self.network if isinstance(layer, nn.Linear)]
        return CorrectionParameters(
            half_width_m=self.half_width_m,
            press_m=self.press_m,
            turned=self.turned,
            share=self.share,
            **{name: tuple(getattr(self, name).tolist()) for name in ("mean", "spread", "low", "high")},
            weights=tuple(tuple(map(tuple, layer.weight.tolist())) for layer in linear),
            biases=tuple(tuple(layer.bias.tolist()) for layer in linear),
        )


def correction_of(parameters: CorrectionParameters) -> MarkCorrection:
    """The correction of these numbers, frozen.

    Raises:
        ValueError: sizes do not fit.
    """
    made = MarkCorrection(
        half_width_m=parameters.half_width_m,
        press_m=parameters.press_m,
        turned=parameters.turned,
        share=parameters.share,
    )
    stored = {name: torch.tensor(getattr(parameters, name)) for name in ("mean", "spread", "low", "high")}
    linear = [number for number, layer in enumerate(made.network) if isinstance(layer, nn.Linear)]
    layers = zip(linear, parameters.weights, parameters.biases, strict=True)
    for number, weight, bias in layers:
        stored |= {f"network.{number}.weight": torch.tensor(weight), f"network.{number}.bias": torch.tensor(bias)}
    try:
        made.load_state_dict(made.state_dict() | stored)
    except RuntimeError as error:
        raise ValueError("the sizes of its layers or inputs do not fit") from error
    return made.requires_grad_(False).eval()


def read_correction(path: Path) -> MarkCorrection | None:
    """Read a model's ``correction.json``: null where the tool has none.

    Raises:
        ContractError: the file is missing or does not hold a correction.
    """
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))
        return None if stored is None else correction_of(from_plain(CorrectionParameters, stored, "the file"))
    except (OSError, ValueError, ContractError) as error:
        raise ContractError(
            f"{path} does not hold the correction of a stroke model ({error}): make it with the stage diagnose_gap."
        ) from error


def is_turned(path: Tensor) -> bool:
    """Whether a tool is turned in paths [B, N, 5]."""
    return bool(path[:, 0, 4].std(correction=0) > TURNED_RAD)
