"""Traj2Stroke: from a commanded path to a mark, with seven parameters (thesis 5.3.4) and an opacity.

| symbol | here | meaning |
|---|---|---|
| m_x, m_y | ``scale`` | the executed path over the commanded one, about the stroke's start |
| b_x, b_y | ``offset_m`` | the executed path's shift against the commanded one, canvas frame |
| α | ``thickness_per_press`` | metres of half-width for each metre of press depth |
| β | ``thickness_at_contact_m`` | half-width at light contact |
| c | ``softness`` | how fast darkness falls from the path (1) to the rim (0) |

The eighth, ``opacity``, is the coverage on the path. The thesis sets it to 1. A photograph's darkest ink is not black;
without this parameter α, β and c would compensate for that.
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

_MIN_RADIUS_M = 1e-5  # of a mark: finer than any pen
_MM = 1e-3


@dataclass(frozen=True)
class Traj2StrokeParameters:
    """The model's parameters in SI units; ``thickness_per_press`` is positive, ``opacity`` lies in (0, 1)."""

    scale: tuple[float, float]
    offset_m: tuple[float, float]
    thickness_per_press: float
    thickness_at_contact_m: float
    softness: float
    opacity: float


class Mark(NamedTuple):
    """What the renderer draws for strokes: canvas frame, metres. Leading dimensions as those of the paths."""

    points_m: Tensor  # [..., N, 2]
    radius_m: Tensor  # [..., N]
    density: Tensor  # [..., N]
    softness: Tensor  # [..., N]


class Traj2Stroke(nn.Module):
    """Paths [..., N, 5] (t_s, x_m, y_m, z_m, yaw_rad) to marks. Lengths are mm inside, for one learning rate."""

    def __init__(self, initial: Traj2StrokeParameters) -> None:
        super().__init__()
        self.scale = nn.Parameter(torch.tensor(initial.scale, dtype=torch.float32))
        self.offset_mm = nn.Parameter(torch.tensor(initial.offset_m, dtype=torch.float32) / _MM)
        self.alpha_raw = nn.Parameter(_softplus_inverse(initial.thickness_per_press))
        self.beta_mm = nn.Parameter(torch.tensor(initial.thickness_at_contact_m / _MM, dtype=torch.float32))
        self.softness_raw = nn.Parameter(_softplus_inverse(initial.softness))
        self.opacity_logit = nn.Parameter(torch.logit(torch.tensor(initial.opacity, dtype=torch.float32)))

    def forward(self, path: Tensor) -> Mark:
        xy, z = path[..., 1:3], path[..., 3]
        start = xy[..., :1, :]
        points = start + self.scale * (xy - start) + self.offset_mm * _MM
        thickness = nn.functional.softplus(self.alpha_raw) * (-z).clamp(min=0.0) + self.beta_mm * _MM
        return Mark(
            points,
            thickness.clamp(min=_MIN_RADIUS_M),
            torch.sigmoid(self.opacity_logit).expand_as(z),
            nn.functional.softplus(self.softness_raw).expand_as(z),
        )

    def parameters_si(self) -> Traj2StrokeParameters:
        """The parameters as numbers with units."""
        thickness_per_press, softness = (
            nn.functional.softplus(raw).item() for raw in (self.alpha_raw.detach(), self.softness_raw.detach())
        )
        scale, offset = self.scale.tolist(), (self.offset_mm * _MM).tolist()
        return Traj2StrokeParameters(
            scale=(scale[0], scale[1]),
            offset_m=(offset[0], offset[1]),
            thickness_per_press=thickness_per_press,
            thickness_at_contact_m=self.beta_mm.item() * _MM,
            softness=softness,
            opacity=torch.sigmoid(self.opacity_logit).item(),
        )


def read_parameters(path: Path) -> Traj2StrokeParameters:
    """Read a model's ``parameters.json``.

    Raises:
        ContractError: the file is missing or does not hold these parameters as numbers in their ranges.
    """
    try:
        parameters = from_plain(Traj2StrokeParameters, json.loads(path.read_text(encoding="utf-8")), "the file")
        if not (parameters.thickness_per_press >= 0 and parameters.softness >= 0 and 0 <= parameters.opacity <= 1):
            raise ValueError("thickness_per_press and softness are 0 or more, opacity lies in [0, 1]")
    except (OSError, ValueError, ContractError) as error:
        raise ContractError(
            f"{path} is not a stroke model ({error}): train one with the stage train_stroke_dynamics."
        ) from error
    return parameters


def _softplus_inverse(value: float) -> Tensor:
    return torch.log(torch.expm1(torch.tensor(max(value, 1e-4), dtype=torch.float32)))
