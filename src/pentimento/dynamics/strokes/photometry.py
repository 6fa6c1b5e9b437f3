"""sRGB and linear light as differentiable functions (IEC 61966-2-1); numpy's are in ``contracts.colour``."""

from __future__ import annotations

from typing import Any, cast

import torch
from torch import Tensor

_LINEAR_BELOW = 0.0031308


def srgb_to_linear(srgb: Tensor) -> Tensor:
    """Linear light of sRGB values in [0, 1], elementwise."""
    return torch.where(srgb <= 0.04045, srgb / 12.92, ((srgb.clamp(min=0.04045) + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(linear: Tensor) -> Tensor:
    """SRGB of linear light in [0, 1], elementwise; its slope is finite everywhere."""
    return cast("Tensor", _Encoded.apply(linear))  # type: ignore[no-untyped-call]


class _Encoded(torch.autograd.Function):
    """The slope of the power law follows from its value: a second power would take as long as the first."""

    @staticmethod
    def forward(ctx: Any, linear: Tensor) -> Tensor:
        curved = linear.clamp(min=_LINEAR_BELOW) ** (1 / 2.4) * 1.055 - 0.055
        srgb = torch.where(linear <= _LINEAR_BELOW, 12.92 * linear, curved)
        ctx.save_for_backward(linear, srgb)
        return srgb

    @staticmethod
    def backward(ctx: Any, *cotangents: Tensor) -> Tensor:
        linear, srgb = ctx.saved_tensors
        slope = (srgb + 0.055) / (2.4 * linear.clamp(min=_LINEAR_BELOW))
        return cotangents[0] * torch.where(linear <= _LINEAR_BELOW, 12.92, slope)
